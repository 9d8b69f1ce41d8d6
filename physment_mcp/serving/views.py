"""Views: what a viewer draws, as JSON in SI units. What may be seen now, where it is, how it moved in the last step.

A drawing holds shapes in the frames of their bodies, poses are as the instruments read them, so a view holds no more
than `get_position` returns. To make one changes nothing and is no call.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from physment_mcp.serving.sight import Seen, Sight
from physment_mcp.session import LabObject, Session
from physment_mcp.tools.episode import STEP
from physment_mcp.world import Pose
from physment_mcp.world.pictures.showing import Frame, ShownPart
from physment_mcp.world.readings import Array

MOST_INSTANTS = 120
"""About how many instants of a step a motion holds."""
_METRES, _QUATERNION = 6, 5
"""Decimals of positions [m] and of orientations: finer ones cannot be seen."""
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)


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


def view_of(session: Session, sight: Sight, states: Sequence[Array] = ()) -> dict[str, Any]:
    """What may be seen now.

    Args:
        session: The episode.
        sight: What may be seen in its scene.
        states: What `recorded` noted during the call just made.

    Returns:
        `time` [s]; `drawing`: bodies as `{"id", "object", "movable", "parts"}`; `poses`: object → position [m]
        and quaternion, as 7 numbers; with states also `motion`: `times` [s] and `poses`, such a list for each time, of
        the objects that moved. Fixtures have no pose, because their parts are given in the world frame.
    """
    seen = sight.seen(session)
    shown = _shown(session, seen)
    # The place of an object of which nothing may be drawn can depend on the seed.
    drawn = [item for item in seen.objects if item.body in shown]
    drawing = _drawing(session, drawn, shown)
    poses = {item.object_id: _numbers(session, item, session.world.pose(item.body)) for item in drawn}
    view = {"time": session.world.time, "drawing": drawing, "poses": poses}
    return view | ({"motion": _motion(session, drawn, states)} if states else {})


def _shown(session: Session, seen: Seen) -> dict[str, list[ShownPart]]:
    """The parts of each body, in its own frame as far as the agent may read its orientation."""
    frames: dict[str, Frame] = dict.fromkeys(seen.fixtures, "world")
    frames |= {item.body: "body" if session.may_read(item, "orientation") else "origin" for item in seen.objects}
    return session.world.shown_parts(frames, seen.parts, seen.turns)


def _drawing(session: Session, drawn: Sequence[LabObject], shown: Mapping[str, list[ShownPart]]) -> dict[str, Any]:
    """Only objects have their own names; those of fixtures may tell too much."""
    names = {item.body: item.object_id for item in drawn}
    fixtures = [parts for body, parts in shown.items() if body not in names]
    bodies: list[dict[str, Any]] = [
        {"id": f"fixture_{number}", "object": False, "movable": False, "parts": _parts(parts)}
        for number, parts in enumerate(fixtures, 1)
    ]
    bodies += [
        {"id": name, "object": True, "movable": session.world.is_movable(body), "parts": _parts(shown[body])}
        for body, name in names.items()
    ]
    return {"bodies": bodies}


def _parts(parts: Iterable[ShownPart]) -> list[dict[str, Any]]:
    return [
        {"shape": part.shape, "size": part.size, "pos": part.position, "quat": part.quaternion, "rgba": part.rgba}
        for part in parts
    ]


def _motion(session: Session, drawn: Sequence[LabObject], states: Sequence[Array]) -> dict[str, Any]:
    world = session.world
    read = world.poses_at(states, [item.body for item in drawn])
    courses = {item.object_id: [_numbers(session, item, pose) for pose in read[item.body]] for item in drawn}
    moved = {name: course for name, course in courses.items() if any(pose != course[0] for pose in course)}
    return {"times": [world.time_of(state) for state in states], "poses": moved}


def _numbers(session: Session, item: LabObject, pose: Pose) -> list[float]:
    turn = pose.quaternion if session.may_read(item, "orientation") else _UPRIGHT
    position = [round(float(value), _METRES) + 0.0 for value in pose.position]
    return position + [round(float(value), _QUATERNION) + 0.0 for value in turn]
