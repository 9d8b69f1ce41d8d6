"""Tests of how often a server's tools are listed, and of the validation of its results."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import anyio
import mcp_types as types
import pytest
from mcp import Client
from mcp.server.caching import CacheHint
from mcp.server.lowlevel import Server

from evaluator.episode.hosts import HostConnector
from evaluator.episode.toolbox import Toolbox, Toolboxes
from tests.builders.records import call

HOUR = CacheHint(ttl_ms=3_600_000, scope="public")
WEIGH = call("weigh")


@dataclass
class Asked:
    """A server with one tool. It counts the requests for its tools, and returns a chosen result."""

    hint: CacheHint | None = HOUR
    result: dict[str, Any] | None = field(default_factory=lambda: {"mass": 2.0})
    output: dict[str, Any] | None = field(
        default_factory=lambda: {"type": "object", "properties": {"mass": {"type": "number"}}, "required": ["mass"]}
    )
    listed: int = 0

    @asynccontextmanager
    async def client(self, mode: str = "auto") -> AsyncGenerator[Client]:
        async def list_tools(_ctx: object, _params: object) -> types.ListToolsResult:
            self.listed += 1
            await anyio.sleep(0.01)
            tool = types.Tool(name="weigh", input_schema={"type": "object"}, output_schema=self.output)
            return types.ListToolsResult(tools=[tool])

        async def call_tool(_ctx: object, _params: object) -> types.CallToolResult:
            return types.CallToolResult(content=[], structured_content=self.result)

        server: Server[object] = Server(
            "x",
            on_list_tools=list_tools,
            on_call_tool=call_tool,
            cache_hints={"tools/list": self.hint} if self.hint else None,
        )
        async with Client(server, cache=None, mode=mode) as client:
            yield client


async def toolboxes_of(asked: Asked, toolboxes: Toolboxes, episodes: int, mode: str = "auto") -> list[Toolbox]:
    """Return the toolboxes of episodes that start concurrently."""
    found: list[Toolbox] = []

    async def ask() -> None:
        async with asked.client(mode) as client:
            found.append(await toolboxes.of(client))

    async with anyio.create_task_group() as tasks:
        for _ in range(episodes):
            tasks.start_soon(ask)
    return found


async def test_a_host_is_asked_for_its_tools_once_for_all_episodes_that_begin_together() -> None:
    asked = Asked()
    found = await toolboxes_of(asked, Toolboxes(), 20)
    assert asked.listed == 1
    assert len(found) == 20
    assert all(toolbox is found[0] for toolbox in found)


async def test_a_host_is_asked_for_its_tools_again_when_its_reply_is_no_longer_fresh() -> None:
    now = [0.0]
    asked, toolboxes = Asked(), Toolboxes(clock=lambda: now[0])
    for now[0], times in ((0.0, 1), (3599.0, 1), (3600.0, 2), (7199.0, 2), (7201.0, 3)):
        await toolboxes_of(asked, toolboxes, 1)
        assert asked.listed == times


@pytest.mark.parametrize("hint", [None, CacheHint(ttl_ms=3_600_000), CacheHint(ttl_ms=0, scope="public")], ids=str)
async def test_a_server_that_does_not_declare_its_tools_public_is_asked_by_every_episode(
    hint: CacheHint | None,
) -> None:
    asked = Asked(hint)
    await toolboxes_of(asked, Toolboxes(), 7)
    assert asked.listed == 7


async def test_a_server_with_an_older_protocol_is_asked_by_every_episode() -> None:
    asked = Asked()
    await toolboxes_of(asked, Toolboxes(), 3, mode="legacy")
    assert asked.listed == 3


async def test_a_host_declares_its_tools_public(host_url: str) -> None:
    laboratory, boxes = HostConnector(host_url), list[Toolbox]()
    for scene in (7, 20):
        async with laboratory.open(scene, 0) as client:
            boxes.append(await laboratory.toolboxes.of(client))
    assert boxes[0] is boxes[1]
    assert len(boxes[0].tools) == 26


@pytest.mark.parametrize(
    ("result", "problem"),
    [({"mass": "two"}, "mass: 'two' is not of type 'number'"), ({}, "'mass' is a required property"), (None, "None")],
)
async def test_a_result_that_does_not_fit_the_published_schema_is_an_error(
    result: dict[str, Any] | None, problem: str
) -> None:
    asked = Asked(result=result)
    async with asked.client() as client:
        toolbox = await Toolboxes().of(client)
        with pytest.raises(ValueError, match="not what the server publishes") as failed:
            await toolbox.run(client, WEIGH)
    assert problem in str(failed.value)


async def test_a_result_that_fits_its_schema_or_has_none_is_returned() -> None:
    for asked in (Asked(), Asked(result={"anything": 1}, output=None)):
        async with asked.client() as client:
            result = await (await Toolboxes().of(client)).run(client, WEIGH)
        assert result.structured_content == asked.result


async def test_scenes_with_equal_tools_share_a_toolbox_and_others_do_not() -> None:
    plain, other, toolboxes = Asked(), Asked(output=None), Toolboxes()
    boxes: dict[int, Toolbox] = {}
    for scene, asked in ((7, plain), (201, other), (8, plain), (7, plain), (201, other)):
        async with asked.client() as client:
            boxes.setdefault(scene, await toolboxes.of(client, scene))
            assert await toolboxes.of(client, scene) is boxes[scene]
    assert (plain.listed, other.listed) == (2, 1)
    assert boxes[7] is boxes[8]
