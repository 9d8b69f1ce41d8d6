"""What goes with a result besides its text: a frame, a view. Made after the call, which it can neither change nor hide.

Knows MCP results. Knows no tools.
"""

import base64
import logging
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import anyio
import anyio.to_thread
import mcp_types as types

from physment_mcp.serving.frames import Frames
from physment_mcp.serving.views import view_of
from physment_mcp.session import Session
from physment_mcp.visibility import Visibility
from physment_mcp.world.readings import Array

logger = logging.getLogger(__name__)

T = TypeVar("T")


async def frame_with(frames: Frames) -> list[types.ImageContent]:
    """The picture for a finished call; none if it could not be drawn."""
    png = await _made(frames.draw, "frame")
    if png is None:
        return []
    return [types.ImageContent(type="image", data=base64.b64encode(png).decode("ascii"), mime_type="image/png")]


async def view_with(
    session: Session, find_visibility: Callable[[Session], Visibility], states: Sequence[Array] = ()
) -> dict[str, Any] | None:
    """The view after a finished call, or of now; None if it could not be made. Arguments as for `view_of`."""
    return await _made(lambda: view_of(session, find_visibility(session), states), "view")


async def _made(make: Callable[[], T | None], what: str) -> T | None:
    """What `make` returns, in a thread; None if it fails. A cancellation waits, since the call has been made."""
    try:
        with anyio.CancelScope(shield=True):
            return await anyio.to_thread.run_sync(make)
    except Exception as crash:
        # The traceback may name hidden things, so it is not logged at the default level.
        logger.error("no %s: %s", what, type(crash).__name__)  # noqa: TRY400
        logger.debug("traceback", exc_info=True)
        return None
