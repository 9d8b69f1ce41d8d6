"""The 26 tools, in their published order."""

from typing import Any

from physment_mcp.tools.act import (
    APPLY_FORCE,
    APPLY_TORQUE,
    CHANGE_POSITION,
    DETECT_COLLISION,
    MOVE_OBJECT,
    SET_VELOCITY,
)
from physment_mcp.tools.base import Tool
from physment_mcp.tools.derive import (
    COMPUTE_FORCE,
    GET_ANGULAR_MOMENTUM,
    GET_KINETIC_ENERGY,
    GET_MOMENTUM,
    GET_POTENTIAL_ENERGY,
    GET_ROTATIONAL_ENERGY,
    QUAT_TO_ROT_MATRIX,
)
from physment_mcp.tools.edit import ATTACH_OBJECTS, CREATE_OBJECTS, DELETE_OBJECTS, FIND_OBJECTS
from physment_mcp.tools.episode import ANSWER, STEP
from physment_mcp.tools.observe import (
    GET_ACCELERATION,
    GET_CENTER_OF_MASS,
    GET_DISPLACEMENT,
    GET_PARAMETERS,
    GET_POSITION,
    GET_TORQUE,
    GET_VELOCITY,
)

TOOLS: tuple[Tool[Any], ...] = (
    STEP,
    GET_POSITION,
    MOVE_OBJECT,
    CHANGE_POSITION,
    GET_VELOCITY,
    SET_VELOCITY,
    GET_ACCELERATION,
    APPLY_FORCE,
    APPLY_TORQUE,
    GET_TORQUE,
    GET_PARAMETERS,
    GET_DISPLACEMENT,
    COMPUTE_FORCE,
    GET_KINETIC_ENERGY,
    GET_POTENTIAL_ENERGY,
    GET_ROTATIONAL_ENERGY,
    GET_MOMENTUM,
    GET_ANGULAR_MOMENTUM,
    GET_CENTER_OF_MASS,
    DETECT_COLLISION,
    QUAT_TO_ROT_MATRIX,
    CREATE_OBJECTS,
    DELETE_OBJECTS,
    FIND_OBJECTS,
    ATTACH_OBJECTS,
    ANSWER,
)

__all__ = ["TOOLS", "Tool"]
