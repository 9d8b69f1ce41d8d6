"""Attachments of a result besides its text: an image for the agent, a view for viewers.

A view is a JSON description of the visible bodies and of their motion during a step. Images and views are made after
the call and can neither change nor hide it. Making one does not count as a call.
"""

import base64
import logging
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import anyio
import anyio.to_thread
import mcp_types as types

from physment_mcp.contract.last_read import Reading
from physment_mcp.serving.frames import Frames
from physment_mcp.session import LabObject, Session
from physment_mcp.tools.episode import STEP
from physment_mcp.visibility import Visibility, Visible, bodies_of, pose_numbers
from physment_mcp.world.pictures.showing import ShownBody, ShownPart
from physment_mcp.world.readings import Array

logger = logging.getLogger(__name__)

T = TypeVar("T")

_NONE: Mapping[str, Reading] = {}
MOST_INSTANTS = 120
"""Approximate number of instants in the motion of a step."""


@contextmanager
def recorded(session: Session, tool: str, arguments: Mapping[str, Any]) -> Generator[Sequence[Array]]:
    """Record states for `view_of` while the block runs a call; none unless the call advances the time."""
    duration = arguments.get("duration")
    if tool != STEP.name or not isinstance(duration, int | float) or not 0 < duration <= 60:
        yield ()
        return
    every = -(-session.world.whole_steps(duration) // MOST_INSTANTS)
    with session.world.recorded(every) as states:
        yield states


def view_of(
    session: Session,
    visibility: Visibility,
    states: Sequence[Array] = (),
    read: Mapping[str, Reading] = _NONE,
) -> dict[str, Any]:
    """Return the current view.

    Args:
        session: The episode.
        visibility: The visibility of its scene.
        states: States that `recorded` yielded for the call just made.
        read: Last position reading of each object, from the results of calls.

    Returns:
        `time` [s]; `drawing`: bodies as `{"id", "object", "movable", "parts"}`, the `schematic` of the pack, if it
        has one, and `names`: object → its name in the table of the opening prompt; `poses`: object → position [m] and
        quaternion, as 7 numbers; with states also `motion`: `times` [s] and `poses`, such a list for each time, of the
        objects that moved. Fixtures have no pose, because their parts are given in the world frame. `read` holds the
        last readings of objects that are not drawn, if there are any.
    """
    visible = visibility.now(session)
    bodies = bodies_of(session, visible)
    view = {
        "time": session.world.time,
        "drawing": {"bodies": [_drawing(body) for body in bodies]} | _schematic(session) | _names(session),
        "poses": {body.name: body.pose for body in bodies if body.pose},
    }
    unseen = {item.object_id for item in session.known()} - {body.name for body in bodies}
    view |= {"read": found} if (found := {name: one for name, one in read.items() if name in unseen}) else {}
    return view | ({"motion": _motion(session, _drawn(visible, bodies), states)} if states else {})


def _schematic(session: Session) -> dict[str, Any]:
    parts = session.scene.public.schematic
    return {"schematic": [part.model_dump(mode="json") for part in parts]} if parts else {}


def _names(session: Session) -> dict[str, Any]:
    names = {item.object_id: item.name for item, _ in session.opening}
    return {"names": names} if names else {}


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


async def frame_with(frames: Frames) -> list[types.ImageContent]:
    """Return the image after a finished call, as MCP content; empty if it could not be rendered."""
    png = await _made(frames.draw, "frame")
    if png is None:
        return []
    return [types.ImageContent(type="image", data=base64.b64encode(png).decode("ascii"), mime_type="image/png")]


async def view_with(
    session: Session,
    find_visibility: Callable[[Session], Visibility],
    states: Sequence[Array] = (),
    read: Mapping[str, Reading] = _NONE,
) -> dict[str, Any] | None:
    """Return the current view, for example after a call; None if that fails. Arguments as for `view_of`."""
    return await _made(lambda: view_of(session, find_visibility(session), states, read), "view")


async def _made(make: Callable[[], T | None], what: str) -> T | None:
    """Run `make` in a thread; None if it fails. Shielded from cancellation, because the call has already been made."""
    try:
        with anyio.CancelScope(shield=True):
            return await anyio.to_thread.run_sync(make)
    except Exception as crash:
        # The traceback may name hidden things, so it is not logged at the default level.
        logger.error("no %s: %s", what, type(crash).__name__)  # noqa: TRY400
        logger.debug("traceback", exc_info=True)
        return None
