"""An independent implementation of a scene's permissions, which detects results that violate them."""

from collections.abc import Callable, Mapping
from typing import Any

from physment_mcp.session import LabObject
from scenes import Permissions
from scenes.protocol import Call

Look = Callable[[LabObject], bool]
"""Returns whether an object is a ball."""

_NEEDS_POSITION = {"get_position", "get_displacement", "get_potential_energy", "move_object", "change_position"}
_NEEDS_VELOCITY = {
    "get_velocity", "get_acceleration", "compute_force", "get_kinetic_energy", "get_momentum", "get_rotational_energy",
    "get_angular_momentum",
}  # fmt: skip
_ACTS = {
    "apply_force", "apply_torque", "set_velocity", "move_object", "change_position", "delete_objects", "attach_objects",
}  # fmt: skip


def named_by(call: Call, objects: Mapping[str, LabObject]) -> list[LabObject | None]:
    """Return the objects that a call names, hidden ones included; None for one that does not exist."""
    ids = [str(value) for name, value in call.arguments.items() if name.endswith("_id")]
    return [objects.get(f"object_{text}" if text.isdecimal() else text) for text in ids]


def overstepped(call: Call, result: Mapping[str, Any], objects: Mapping[str, LabObject], is_ball: Look) -> str:
    """Describe what a call obtained or did without permission of its scene; empty if nothing.

    Args:
        call: The call, which was not refused.
        result: Its result.
        objects: The objects by id, before the call.
        is_ball: Function that returns whether an object is a ball.
    """
    named = named_by(call, objects)
    for item in named:
        if item is None or not item.known:
            return "acts on an object that the agent does not know"
        may = item.permissions
        if call.tool in _NEEDS_POSITION and not may.body_pos:
            return "needs the position, which is withheld"
        if call.tool in _NEEDS_VELOCITY and not may.velocity:
            return "needs the velocity, which is withheld"
        if call.tool in _ACTS and not may.actuate:
            return "acts on a sealed object"
    return _shown(call, result, [item for item in named if item], objects, is_ball)


def _shown(
    call: Call, result: Mapping[str, Any], named: list[LabObject], objects: Mapping[str, LabObject], is_ball: Look
) -> str:
    """Return a withheld field that a result shows."""
    may = named[0].permissions if named else Permissions()
    shown: dict[str, bool] = {}
    match call.tool:
        case "get_position":
            shown = {"orientation": may.body_quat, "angle": may.angle}
        case "get_velocity":
            shown = {"angular_velocity": may.spin is True}
        case "get_rotational_energy" | "get_angular_momentum":
            shown = {call.tool.removeprefix("get_"): may.spin is not False}
        case "get_parameters":
            shown = {"mass": _mass(named[0], is_ball), "bounding_box": _size(named[0], is_ball), "type": may.geom_type}
        case "set_velocity":
            shown = {"velocity": may.velocity}
        case "detect_collision":
            shown = _of_a_contact(result, [item.permissions for item in named])
        case "get_center_of_mass":
            counted = [objects[name] for name in result["included"]]
            known = [*result["included"], *result["excluded"]]
            shown = {
                "included": all(_mass(item, is_ball) and item.permissions.body_pos for item in counted),
                "excluded": all(objects[name].known for name in known),
            }
        case _:
            pass
    return next((f"shows {name}, which is withheld" for name, may in shown.items() if result[name] and not may), "")


def _of_a_contact(result: Mapping[str, Any], pair: list[Permissions]) -> dict[str, bool]:
    place, speed = all(may.body_pos for may in pair), all(may.velocity for may in pair)
    if result["impulse"] and not all(may.actuate for may in pair):
        return {"impulse": False}
    return {"contact_point": place, "normal": place, "approach_speed": place and speed, "impulse": place and speed}


def _size(item: LabObject, is_ball: Look) -> bool:
    may = item.permissions
    return may.geom_size or (may.geom_radius and is_ball(item))


def _mass(item: LabObject, is_ball: Look) -> bool:
    may = item.permissions
    return may.body_mass or (may.geom_density and _size(item, is_ball))
