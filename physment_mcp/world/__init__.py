"""The physical world behind the tools: the only package that imports mujoco.

Takes body names, and returns SI arrays in the world frame. Contains no MCP, pydantic, scene files, permissions or
answers.
"""

from physment_mcp.world.readings import Contact, HingeMotion, Pose, Shape, Twist
from physment_mcp.world.readout import Fineness, Readout
from physment_mcp.world.simulation import Snapshot
from physment_mcp.world.world import World

__all__ = ["Contact", "Fineness", "HingeMotion", "Pose", "Readout", "Shape", "Snapshot", "Twist", "World"]
