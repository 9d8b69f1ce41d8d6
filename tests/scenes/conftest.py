"""A laboratory in memory: the same server and client, without a process or a socket between them."""

import contextlib
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcp import Client

from physment_mcp.scene import load_scene
from physment_mcp.server import Laboratory, build_server
from physment_mcp.session import Session


@dataclass(frozen=True)
class MemoryLaboratory:
    """Serves the packs of a folder."""

    folder: Path | None = None

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        async with Client(build_server(Laboratory(Session(load_scene(scene, seed, self.folder))))) as client:
            yield client


@pytest.fixture
def laboratory() -> type[MemoryLaboratory]:
    """From a folder of packs to what serves them."""
    return MemoryLaboratory


@pytest.fixture
def memory() -> MemoryLaboratory:
    """Serves the suite."""
    return MemoryLaboratory()
