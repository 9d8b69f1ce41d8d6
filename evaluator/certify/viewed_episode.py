"""In-process episodes that send views to their client, of the visible bodies or, for scene authors, of all bodies."""

import contextlib
import functools
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mcp import Client

from evaluator.episode.toolbox import shows_views
from evaluator.errors import UsageError
from physment_mcp.errors import SceneError
from physment_mcp.scene import Scene, load_scene
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from physment_mcp.visibility import Visibility, Visible, cached_visibility, visibility_of
from scenes import Permissions

_ALL = Permissions(geom_type=True, geom_size=True, geom_radius=True, body_pos=True, body_quat=True)


@dataclass(frozen=True, slots=True)
class _Everything(Visibility):
    """A visibility rule without restrictions: all objects, hidden ones included, with their true attributes."""

    def now(self, session: Session) -> Visible:
        objects = tuple(replace(item, permissions=_ALL) for item in session.state.objects.values())
        for item in session.state.objects.values():
            if item.permissions.hidden:
                session.world.reveal(item.body)
        made = {(item.body, 0) for item in objects if item.created}
        return Visible(objects, self.fixtures, self.parts | made, {})


@functools.cache
def viewing(scenes_dir: Path | None, *, reveal: bool) -> Callable[[Scene], Visibility]:
    """Return the function that determines the visibility in scenes of a folder.

    Args:
        scenes_dir: Folder of scene packs; None for the suite.
        reveal: Whether all bodies are visible, and not only those that an agent may see.
    """
    if not reveal:
        return cached_visibility(scenes_dir)

    def everything(scene: Scene) -> Visibility:
        found = visibility_of(scene, ())
        return _Everything(found.parts, found.fixtures, {})

    return everything


@contextlib.asynccontextmanager
async def viewed_episode(
    scene: int, seed: int, scenes_dir: Path | None, find_visibility: Callable[[Scene], Visibility]
) -> AsyncGenerator[Client]:
    """Open a new episode and yield a client that receives views, as clients that support MCP Apps do.

    Raises:
        UsageError: There is no such scene, or the folder lacks variants of it that the visibility rule needs.
    """
    try:
        session = Session(load_scene(scene, seed, scenes_dir))
        find_visibility(session.scene)
    except SceneError as error:
        raise UsageError(str(error)) from error
    async with Client(
        build_server(EpisodeSlot(session, find_visibility=find_visibility)), cache=None, extensions=[shows_views()]
    ) as client:
        yield client
