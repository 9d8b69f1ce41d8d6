"""Tests of long steps over HTTP: progress is reported; a step whose client cancels or disconnects changes nothing."""

import json
from typing import Any

import anyio
import httpx
import pytest
from mcp import Client

SLOW_SCENE = 99
"""A step of 60 s takes about 1 s in this scene, and 0.05 s in scene 7. A cancellation must arrive during the step, even
on a loaded machine."""


async def opened(host_url: str, scene: int = 7) -> str:
    async with httpx.AsyncClient(base_url=host_url) as http:
        return (await http.post("/episodes", json={"scene": scene})).json()["mcp_url"]


async def clock(client: Client) -> float:
    """Return the simulated time after the running call has ended."""
    seen = await client.call_tool("quat_to_rot_matrix", {"q": [1, 0, 0, 0]})
    assert seen.structured_content is not None
    return seen.structured_content["sim_time"]


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_progress_is_seen_over_http(host_url: str, mode: Any) -> None:
    seen: list[tuple[float, float | None]] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        seen.append((progress, total))

    with anyio.fail_after(120):
        async with Client(await opened(host_url), mode=mode) as client:
            result = await client.call_tool("step", {"duration": 20}, progress_callback=note)
            assert not result.is_error
    assert seen
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    assert {total for _, total in seen} == {20.0}


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_step_cancelled_over_http_changes_nothing(host_url: str, mode: Any) -> None:
    with anyio.fail_after(120):
        async with Client(await opened(host_url, SLOW_SCENE), mode=mode) as client:
            await client.call_tool("step", {"duration": 0.5})
            async with anyio.create_task_group() as tasks:

                async def stop(progress: float, total: float | None, message: str | None) -> None:
                    tasks.cancel_scope.cancel()

                await client.call_tool("step", {"duration": 60}, progress_callback=stop)
                pytest.fail("60 s are many chunks: the first report of progress comes before the end")
            assert await clock(client) == pytest.approx(0.5)
            (contents,) = (await client.read_resource("physment://measurements")).contents
            assert json.loads(contents.text)["calls"][1] == {
                "call": 2, "tool": "step", "arguments": {"duration": 60}, "taken_back": True,
            }  # fmt: skip


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_that_disconnects_during_a_step_can_reconnect(host_url: str, mode: Any) -> None:
    with anyio.fail_after(120):
        url = await opened(host_url)
        async with anyio.create_task_group() as tasks:

            async def leave(progress: float, total: float | None, message: str | None) -> None:
                tasks.cancel_scope.cancel()

            async with Client(url, mode=mode) as client:
                await client.call_tool("step", {"duration": 60}, progress_callback=leave)
        async with Client(url, mode=mode) as client:
            assert await clock(client) in (0.0, pytest.approx(60))  # no part of the step, or all of it
            stepped = await client.call_tool("step", {"duration": 0.5})
            assert not stepped.is_error
