"""Frames: images of the visible bodies, which a separate process renders. Results of calls contain them.

The process receives only what `visibility` permits. If it fails, results have no frame.
"""

import base64
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Lock, Timer

from physment_mcp.errors import UsageError
from physment_mcp.scene import load_variants
from physment_mcp.session import Session
from physment_mcp.visibility import bodies_of, visibility_of
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.showing import picture_model, view_of_shown

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
