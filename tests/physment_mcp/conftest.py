"""Tiny packs on disk, and the scene they describe: with a client in memory, and on a host without sockets."""

import contextlib
import json
import sys
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client

from physment_mcp.scene import load_scene
from physment_mcp.serving.host import Host
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from tests.builders.bench import PUBLIC, Bench, ball_mjcf, fingerprint, open_bench

# A floor, a free ball, a free box, a sealed ball, a hidden ball, a ball of which nothing is told, a pendulum of two
# links and a post. Nothing touches anything.
XML = """
<mujoco>
  <option timestep="0.005" integrator="RK4" cone="elliptic" impratio="10" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="object_1" pos="0 0 1">
      <joint name="j1" type="free"/><geom type="sphere" size="0.1" density="1000"/>
    </body>
    <body name="object_2" pos="1 0 1">
      <joint name="j2" type="free"/><geom type="box" size="0.1 0.2 0.3" density="500"/>
    </body>
    <body name="object_3"><geom type="plane" size="50 50 0.1"/></body>
    <body name="object_4" pos="2 0 1">
      <joint name="j4" type="free"/><geom type="sphere" size="0.1" density="1000"/>
    </body>
    <body name="object_5" pos="3 0 1">
      <joint name="j5" type="free"/><geom type="sphere" size="0.1" density="1000" rgba="0 0 0 0"/>
    </body>
    <body name="object_6" pos="4 0 1">
      <joint name="j6" type="free"/><geom type="sphere" size="0.1" density="1000"/>
    </body>
    <body name="object_7" pos="5 0 3">
      <joint name="j7" type="hinge" axis="0 1 0"/><geom type="sphere" pos="0 0 -0.5" size="0.1" density="1000"/>
      <body name="object_8" pos="0 0 -0.5">
        <joint name="j8" type="hinge" axis="0 1 0"/><geom type="sphere" pos="0 0 -0.5" size="0.1" density="1000"/>
      </body>
    </body>
    <body name="object_9" pos="6 0 1"><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
</mujoco>
"""


def _pack() -> dict[str, Any]:
    names = ("ball", "box", "floor", "sealed ball", "ghost", "masked ball", "upper link", "lower link", "post")
    permissions: dict[str, dict[str, bool]] = {f"object_{n}_permissions": dict(PUBLIC) for n in range(1, 10)}
    permissions["object_4_permissions"]["actuate"] = False
    permissions["object_5_permissions"]["hidden"] = True
    permissions["object_6_permissions"] = {"velocity": False}
    return {
        "metadata": {
            "scene_name": "All kinds",
            "task": "How heavy is the ball?",
            "problem_type": "calculation",
            "description": "For tests.",
        },
        "answer": 1.0,
        "expected_behavior": "",
        "reasoning": "",
        "number_of_objects": len(names),
        "objects": {f"object_{n}": {"name": name, "object_id": str(n)} for n, name in enumerate(names, 1)},
        "object_permissions": permissions,
        "answer_spec": {"kind": "number", "unit": "kg"},
    }


@dataclass
class Lab:
    """A client, and the session it talks to."""

    client: Client
    session: Session

    async def call(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """The structured result of a call that succeeds."""
        result = await self.client.call_tool(tool, arguments)
        assert not result.is_error, result.content
        assert result.structured_content is not None
        return result.structured_content

    async def refused(self, tool: str, **arguments: Any) -> str:
        """The sentence of a call that is refused; checks that it changed nothing."""
        before = self.state()
        result = await self.client.call_tool(tool, arguments)
        assert result.is_error, result.structured_content
        assert result.structured_content is None
        assert len(result.content) == 1
        assert self.state() == before
        sentence = result.content[0].text
        assert sentence
        assert "\n" not in sentence
        assert "failed inside the laboratory" not in sentence
        return sentence

    def state(self) -> tuple[Any, ...]:
        """All that a refused call must leave as it was."""
        return fingerprint(self.session)


@pytest.fixture
def pack() -> dict[str, Any]:
    """A pack to change before it is written."""
    return _pack()


@pytest.fixture
def xml() -> str:
    return XML


@pytest.fixture
def write_pack(tmp_path: Path) -> Callable[..., Path]:
    """Write a pack; returns the folder of packs."""

    def write(pack: dict[str, Any], xml: str, scene_id: int = 7) -> Path:
        folder = tmp_path / "packs" / f"Scene{scene_id}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"scene{scene_id}.json").write_text(json.dumps(pack), encoding="utf-8")
        (folder / f"scene{scene_id}.xml").write_text(xml, encoding="utf-8")
        return folder.parent

    return write


@pytest.fixture
def open_lab(write_pack: Callable[..., Path]) -> Callable[..., Any]:
    """Open a lab on a pack, the one of all kinds unless told otherwise."""

    @contextlib.asynccontextmanager
    async def opened(
        pack: dict[str, Any] | None = None, xml: str = XML, *, seed: int = 0, mode: Any = "auto"
    ) -> AsyncGenerator[Lab]:
        session = Session(load_scene(7, seed, write_pack(pack or _pack(), xml)))
        async with Client(build_server(EpisodeSlot(session)), mode=mode) as client:
            yield Lab(client, session)

    return opened


@pytest.fixture
def command() -> Callable[..., list[str]]:
    """The command line of the server under test."""

    def build(*arguments: object) -> list[str]:
        return [sys.executable, "-m", "physment_mcp", *(str(argument) for argument in arguments)]

    return build


@pytest.fixture
def inside(write_pack: Callable[..., Path], pack: dict[str, Any], xml: str) -> Callable[..., Any]:
    """A host in this process, spoken to without sockets."""
    folder = write_pack(pack, xml)

    @contextlib.asynccontextmanager
    async def opened(**options: Any) -> AsyncGenerator[tuple[Host, httpx.AsyncClient]]:
        host = Host(scenes_dir=folder, **options)
        app = host.app()
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1") as http,
        ):
            yield host, http

    return opened


@pytest.fixture
def bench() -> Callable[..., Bench]:
    """Opens a bench: a session on inline bodies, without MCP."""
    return open_bench


@pytest.fixture
def ball() -> Callable[..., str]:
    """MJCF of a ball."""
    return ball_mjcf
