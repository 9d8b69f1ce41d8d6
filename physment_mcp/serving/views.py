"""Attachments of a result besides its text: an image for the agent, a view for viewers.

A separate process, which receives only what `visibility` permits, renders the images. If it fails, results have none. A
view is a JSON description of the visible bodies and of their motion during a step. Images and views are made after the
call and can neither change nor hide it. Making one does not count as a call.
"""

import base64
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock, Timer
from typing import Any, TypeVar

import anyio
import anyio.to_thread
import mcp_types as types

from physment_mcp.contract.last_read import Reading
from physment_mcp.errors import UsageError
from physment_mcp.scene import load_variants
from physment_mcp.session import LabObject, Session
from physment_mcp.tools.episode import STEP
from physment_mcp.visibility import Visibility, Visible, bodies_of, pose_numbers, visibility_of
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.showing import ShownBody, ShownPart, picture_model, view_of_shown
from physment_mcp.world.readings import Array

logger = logging.getLogger(__name__)

SHOWING_TOOLS = frozenset({"step", "find_objects"})
"""Tools whose results carry a frame."""
_RENDERER = "MUJOCO_GL"
"""Environment variable by which MuJoCo chooses the graphics library."""
_OFF_SCREEN = ("osmesa", "egl")
_PATIENCE_S = 60.0


class Painter:
    """The rendering process, which renders one image at a time. It ends with this process or with `close`."""

    def __init__(self) -> None:
        """Start the process.

        Raises:
            UsageError: This machine cannot render off-screen.
        """
        self._lock = Lock()
        self._process = _started()

    def draw(self, mjcf: str, view: View) -> bytes | None:
        """Render a model as PNG; None if that fails. Blocks."""
        request = {
            "mjcf": mjcf,
            "centre": view.centre.tolist(),
            "distance": view.distance,
            "extent": view.extent,
        }
        with self._lock:
            try:
                if self._process.poll() is not None:
                    self._end()
                    self._process = _started()
                reply = _asked(self._process, json.dumps(request))
            except (OSError, UsageError):
                reply = ""
        if not reply:
            logger.warning("a frame could not be drawn; the result goes without")
            return None
        return base64.b64decode(reply)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.communicate()


class Frames:
    """The frames of one episode."""

    def __init__(self, session: Session, variants: Sequence[str], painter: Painter) -> None:
        """Determine the visible bodies of the scene.

        Args:
            session: The episode.
            variants: MJCF of the scene at enough other seeds to show everything that depends on the seed.
            painter: The rendering process.
        """
        self._session, self._painter = session, painter
        self._visibility = visibility_of(session.scene, variants)
        self._seen: frozenset[str] = frozenset()
        self._view: View | None = None

    def draw(self) -> bytes | None:
        """Render the currently visible bodies as PNG; None if there are none or rendering fails. Blocks.

        The camera stays fixed while the set of visible bodies stays the same.
        """
        bodies = bodies_of(self._session, self._visibility.now(self._session))
        mjcf, seen = picture_model(bodies), frozenset(body.name for body in bodies)
        if not mjcf:
            return None
        if self._view is None or seen != self._seen:
            self._view, self._seen = view_of_shown(mjcf), seen
        return self._painter.draw(mjcf, self._view)


def watching(observations: str, scenes_dir: Path | None) -> Callable[[Session], Frames] | None:
    """Return the factory of frames for a value of `--observations`; None for text only.

    Raises:
        UsageError: This machine cannot render off-screen.
    """
    if observations == "text":
        return None
    painter = Painter()
    return lambda session: Frames(session, load_variants(session.scene.public.scene_id, scenes_dir), painter)


def _started() -> "subprocess.Popen[str]":
    chosen = os.environ.get(_RENDERER)
    for renderer in (chosen,) if chosen else _OFF_SCREEN:
        process = subprocess.Popen(
            [sys.executable, "-m", "physment_mcp.world.pictures.painter"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, _RENDERER: renderer},
            text=True,
        )
        if _asked(process, None) == "ready":
            return process
        process.kill()
        process.communicate()
    raise UsageError(
        f"--observations rgb: nothing draws off-screen here ({_RENDERER} as {chosen or ' or '.join(_OFF_SCREEN)});"
        " install libosmesa6"
    )


def _asked(process: "subprocess.Popen[str]", request: str | None) -> str:
    """Write a request to the rendering process, if there is one, and return its next line.

    The line is empty if the process ended or did not reply in time.
    """
    assert process.stdin is not None
    assert process.stdout is not None
    watch = Timer(_PATIENCE_S, process.kill)
    watch.daemon = True
    watch.start()
    try:
        if request is not None:
            process.stdin.write(request + "\n")
            process.stdin.flush()
        return process.stdout.readline().strip()
    finally:
        watch.cancel()


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
        quaternion, as 7 numbers; with states also `motion`: `times` [s], and `poses`: object that moved → its pose at
        each of these times. Fixtures have no pose, because their parts are given in the world frame. `read` holds the
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
