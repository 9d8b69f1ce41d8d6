"""A small pack that contains an object of every kind, and types of the fixtures that open it with a client."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from mcp import Client
from mcp_types import Implementation

from physment_mcp.serving.episode_server import EpisodeServer
from physment_mcp.session import Session
from tests.builders.bench import PUBLIC, fingerprint

# A floor, a free ball, a free box, a sealed ball, a hidden ball, a masked ball (everything about it is withheld), a
# pendulum of two links, and a post. Nothing touches anything else.
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


def pack_of_all_kinds() -> dict[str, Any]:
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
    """A client in memory, and the session of its server."""

    client: Client
    session: Session

    async def call(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """The structured result of a call that succeeds."""
        result = await self.client.call_tool(tool, arguments)
        assert not result.is_error, result.content
        assert result.structured_content is not None
        return result.structured_content

    async def refused(self, tool: str, **arguments: Any) -> str:
        """Make a call that must be refused, check that it changed nothing, and return the error message."""
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

    @property
    def instructions(self) -> str:
        """The instructions that the server sends at the start."""
        assert self.client.instructions is not None
        return self.client.instructions

    @property
    def server_info(self) -> Implementation:
        """Name and version that the server reports."""
        assert self.client.server_info is not None
        return self.client.server_info

    def state(self) -> tuple[Any, ...]:
        """Return a fingerprint of everything that a refused call must not change."""
        return fingerprint(self.session)


WritePack = Callable[..., Path]
"""Writes a pack with its MJCF, under scene id 7 unless another id is given; returns the folder of packs."""
Command = Callable[..., list[str]]
"""Returns the command line that starts the server under test with these arguments."""
OpenLab = Callable[..., AbstractAsyncContextManager[Lab]]
"""Opens a lab on a pack and its MJCF."""
OpenHost = Callable[..., AbstractAsyncContextManager[tuple[EpisodeServer, httpx.AsyncClient]]]
"""Starts a host in this process with options of `EpisodeServer`, and a client that needs no socket."""
