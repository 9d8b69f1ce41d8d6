"""Sessions whose results contain pictures. Tests that use them are skipped where rendering is unavailable."""

import contextlib
from collections.abc import AsyncGenerator, Iterator

import pytest
from mcp import Client

from physment_mcp.errors import UsageError
from physment_mcp.scene import load_scene, load_variants
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.serving.views import Frames, Painter
from physment_mcp.session import Session


def open_painter() -> Iterator[Painter]:
    """Start the rendering process; skips the test if rendering is not available."""
    try:
        made = Painter()
    except UsageError as error:
        pytest.skip(str(error))
    yield made
    made.close()


@contextlib.asynccontextmanager
async def watched_scene(painter: Painter) -> AsyncGenerator[Client]:
    """A client of scene 7 whose results contain pictures."""
    slot = EpisodeSlot(
        Session(load_scene(7, 0)), watch=lambda session: Frames(session, load_variants(7, None), painter)
    )
    async with Client(build_server(slot)) as client:
        yield client
