"""The physical world behind the tools: the one room that imports mujoco.

Body names in, SI arrays in the world frame out. Knows no MCP, pydantic, scene files, permissions or answers.
"""

from physment_mcp.world.readings import Contact, HingeMotion, Pose, Shape, Twist
from physment_mcp.world.readout import Fineness, Readout
from physment_mcp.world.simulation import Snapshot
from physment_mcp.world.world import World

__all__ = ["Contact", "Fineness", "HingeMotion", "Pose", "Readout", "Shape", "Snapshot", "Twist", "World"]
