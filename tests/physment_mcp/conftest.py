"""Small packs on disk, opened with a client in memory, or on a host without sockets."""

import contextlib
import json
import sys
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client

from physment_mcp.scene import load_scene
from physment_mcp.serving.episode_server import EpisodeServer
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from tests.builders.laboratory import XML, Command, Lab, OpenHost, OpenLab, WritePack, pack_of_all_kinds


@pytest.fixture
def pack() -> dict[str, Any]:
    """The fields of a valid pack, which a test may change before it writes them to a file."""
    return pack_of_all_kinds()


@pytest.fixture
def xml() -> str:
    return XML


@pytest.fixture
def write_pack(tmp_path: Path) -> WritePack:
    """Write a pack; returns the folder of packs."""

    def write(pack: dict[str, Any], xml: str, scene_id: int = 7) -> Path:
        folder = tmp_path / "packs" / f"Scene{scene_id}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"scene{scene_id}.json").write_text(json.dumps(pack), encoding="utf-8")
        (folder / f"scene{scene_id}.xml").write_text(xml, encoding="utf-8")
        return folder.parent

    return write


@pytest.fixture
def open_lab(write_pack: WritePack) -> OpenLab:
    """Open a lab on a pack; by default the pack with objects of all kinds."""

    @contextlib.asynccontextmanager
    async def opened(
        pack: dict[str, Any] | None = None, xml: str = XML, *, seed: int = 0, mode: Any = "auto"
    ) -> AsyncGenerator[Lab]:
        session = Session(load_scene(7, seed, write_pack(pack or pack_of_all_kinds(), xml)))
        async with Client(build_server(EpisodeSlot(session)), mode=mode) as client:
            yield Lab(client, session)

    return opened


@pytest.fixture
def command() -> Command:
    """The command line of the server under test."""

    def build(*arguments: object) -> list[str]:
        return [sys.executable, "-m", "physment_mcp", *(str(argument) for argument in arguments)]

    return build


@pytest.fixture
def inside(write_pack: WritePack, pack: dict[str, Any], xml: str) -> OpenHost:
    """Start a host in this process, and connect to it without sockets."""
    folder = write_pack(pack, xml)

    @contextlib.asynccontextmanager
    async def opened(**options: Any) -> AsyncGenerator[tuple[EpisodeServer, httpx.AsyncClient]]:
        host = EpisodeServer(scenes_dir=folder, **options)
        app = host.app()
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1") as http,
        ):
            yield host, http

    return opened
