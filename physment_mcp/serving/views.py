"""Views: what may be seen now, and how it moved during a step, in JSON for viewers. Making one is no call."""

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from physment_mcp.session import LabObject, Session
from physment_mcp.tools.episode import STEP
from physment_mcp.visibility import Visibility, Visible, bodies_of, pose_numbers
from physment_mcp.world.pictures.showing import ShownBody, ShownPart
from physment_mcp.world.readings import Array

MOST_INSTANTS = 120
"""About how many instants of a step a motion holds."""


@contextmanager
def recorded(session: Session, tool: str, arguments: Mapping[str, Any]) -> Generator[Sequence[Array]]:
    """Note states while a call runs in the block, for `view_of`; none unless it lets time pass."""
    duration = arguments.get("duration")
    if tool != STEP.name or not isinstance(duration, int | float) or not 0 < duration <= 60:
        yield ()
        return
    every = -(-session.world.whole_steps(duration) // MOST_INSTANTS)
    with session.world.recorded(every) as states:
        yield states


def view_of(session: Session, visibility: Visibility, states: Sequence[Array] = ()) -> dict[str, Any]:
    """What may be seen now.

    Args:
        session: The episode.
        visibility: What may be seen in its scene.
        states: What `recorded` noted during the call just made.

    Returns:
        `time` [s]; `drawing`: bodies as `{"id", "object", "movable", "parts"}`; `poses`: object → position [m]
        and quaternion, as 7 numbers; with states also `motion`: `times` [s] and `poses`, such a list for each time, of
        the objects that moved. Fixtures have no pose, because their parts are given in the world frame.
    """
    visible = visibility.now(session)
    bodies = bodies_of(session, visible)
    view = {
        "time": session.world.time,
        "drawing": {"bodies": [_drawing(body) for body in bodies]},
        "poses": {body.name: body.pose for body in bodies if body.pose},
    }
    return view | ({"motion": _motion(session, _drawn(visible, bodies), states)} if states else {})


def _drawn(visible: Visible, bodies: Sequence[ShownBody]) -> list[LabObject]:
    names = {body.name for body in bodies}
    return [item for item in visible.objects if item.object_id in names]


def _drawing(body: ShownBody) -> dict[str, Any]:
    return {"id": body.name, "object": bool(body.pose), "movable": body.movable, "parts": _parts(body.parts)}


def _parts(parts: Iterable[ShownPart]) -> list[dict[str, Any]]:
    return [
        {"shape": part.shape, "size": part.size, "pos": part.position, "quat": part.quaternion, "rgba": part.rgba}
        for part in parts
    ]


def _motion(session: Session, drawn: Sequence[LabObject], states: Sequence[Array]) -> dict[str, Any]:
    world = session.world
    read = world.poses_at(states, [item.body for item in drawn])
    courses = {item.object_id: [pose_numbers(session, item, pose) for pose in read[item.body]] for item in drawn}
    moved = {name: course for name, course in courses.items() if any(pose != course[0] for pose in course)}
    return {"times": [world.time_of(state) for state in states], "poses": moved}
