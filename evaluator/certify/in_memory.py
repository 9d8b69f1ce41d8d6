"""A laboratory in this process: the usual server and client, connected in memory."""

import contextlib
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field
from pathlib import Path

from mcp import Client

from evaluator.episode.toolbox import Toolboxes
from physment_mcp import open_episode


@dataclass(frozen=True, slots=True)
class MemoryConnector:
    """Serves the packs of a folder."""

    folder: Path | None = None
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """A client connected to a new episode."""
        server = open_episode(scene, seed, scenes_dir=self.folder).server()
        async with Client(server, cache=None) as client:
            yield client
