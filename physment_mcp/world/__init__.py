"""The physical world behind the tools: the one room that imports mujoco.

Body names in, SI arrays in the world frame out. Knows no MCP, pydantic, scene files, permissions or answers.
"""

from physment_mcp.world.readings import Contact, Pose, Shape, Twist
from physment_mcp.world.world import Snapshot, World

__all__ = ["Contact", "Pose", "Shape", "Snapshot", "Twist", "World"]
