"""What may be seen now: bodies with their shapes, each where the instruments read it; and views, their form in JSON.

Pictures and viewers are made from these bodies alone. Shapes are given in the frames of their bodies and poses are
readings, so neither shows a place more finely than `get_position` returns it. Looking changes nothing and is no call.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from physment_mcp.serving.sight import Seen, Sight
from physment_mcp.session import LabObject, Session
from physment_mcp.tools.episode import STEP
from physment_mcp.world import Pose
from physment_mcp.world.pictures.showing import Frame, ShownBody, ShownPart
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
    bodies = _bodies(session, seen)
    view = {
        "time": session.world.time,
        "drawing": {"bodies": [_drawing(body) for body in bodies]},
        "poses": {body.name: body.pose for body in bodies if body.pose},
    }
    return view | ({"motion": _motion(session, _drawn(seen, bodies), states)} if states else {})


def bodies_of(session: Session, sight: Sight) -> list[ShownBody]:
    """The bodies that may be seen now, with the parts of them that may be seen: fixtures first.

    Objects have their ids as names. Fixtures have numbers, because their own names may tell too much; a colon keeps
    them apart from the names that agents give.
    """
    return _bodies(session, sight.seen(session))


def _bodies(session: Session, seen: Seen) -> list[ShownBody]:
    frames: dict[str, Frame] = dict.fromkeys(seen.fixtures, "world")
    frames |= {item.body: "body" if session.may_read(item, "orientation") else "origin" for item in seen.objects}
    shown = session.world.shown_parts(frames, seen.parts, seen.turns)
    fixtures = [parts for body, parts in shown.items() if body in seen.fixtures]
    found = [ShownBody(f"fixture:{number}", False, (), parts) for number, parts in enumerate(fixtures, 1)]
    for item in seen.objects:
        # The place of an object of which nothing may be drawn can depend on the seed.
        if item.body in shown:
            pose = _numbers(session, item, session.world.pose(item.body))
            found.append(ShownBody(item.object_id, session.world.is_movable(item.body), pose, shown[item.body]))
    return found


def _drawn(seen: Seen, bodies: Sequence[ShownBody]) -> list[LabObject]:
    names = {body.name for body in bodies}
    return [item for item in seen.objects if item.object_id in names]


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
    courses = {item.object_id: [_numbers(session, item, pose) for pose in read[item.body]] for item in drawn}
    moved = {name: course for name, course in courses.items() if any(pose != course[0] for pose in course)}
    return {"times": [world.time_of(state) for state in states], "poses": moved}


def _numbers(session: Session, item: LabObject, pose: Pose) -> list[float]:
    turn = pose.quaternion if session.may_read(item, "orientation") else _UPRIGHT
    position = [round(float(value), _METRES) + 0.0 for value in pose.position]
    return position + [round(float(value), _QUATERNION) + 0.0 for value in turn]
