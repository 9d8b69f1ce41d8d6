"""Finds the positions at which objects were last read, from calls and their results alone."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard, cast

Reading = dict[str, Any]
"""`position` [m], `time` of the reading [s] and, if it was returned, `angle` [rad]."""

_PLACES = {"get_position": "position", "move_object": "position", "change_position": "new_position"}
"""Tool → field of its result that holds the position of the object."""


def read_after(
    before: Mapping[str, Reading], tool: str, arguments: Mapping[str, Any], content: Mapping[str, Any]
) -> dict[str, Reading]:
    """Return the last reading of each object after a call.

    Args:
        before: The last readings before the call, by object id.
        tool: Name of the tool.
        arguments: Arguments of the call.
        content: Its result.
    """
    time = content.get("sim_time")
    if not _is_number(time):
        return dict(before)
    gone = {content.get("object_id"), *content.get("also_deleted", ())} if tool == "delete_objects" else ()
    kept = {name: reading for name, reading in before.items() if name not in gone}
    return kept | {name: reading | {"time": time} for name, reading in _places(tool, arguments, content)}


def _places(tool: str, arguments: Mapping[str, Any], content: Mapping[str, Any]) -> Iterator[tuple[str, Reading]]:
    found: list[tuple[object, object, object]] = []
    if tool in _PLACES:
        found.append((arguments.get("object_id"), content.get(_PLACES[tool]), content.get("angle")))
    elif tool == "find_objects":
        found += [(one.get("object_id"), one.get("position"), None) for one in content.get("revealed", ())]
    for name, place, angle in found:
        if (
            isinstance(place, list)
            and len(cast(list[Any], place)) == 3
            and all(map(_is_number, cast(list[Any], place)))
        ):
            identity = f"object_{name}" if str(name).isdecimal() else str(name)
            yield identity, {"position": place} | ({"angle": angle} if _is_number(angle) else {})


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
