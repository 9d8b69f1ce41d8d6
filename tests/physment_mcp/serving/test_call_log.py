"""Tests of the file to which a host logs the calls of an external program: all calls, limited size, private mode."""

import contextlib
import json
import math
import subprocess
import time
from collections.abc import AsyncGenerator
from typing import Any

import anyio
import httpx
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp_types import CallToolRequestParams, CallToolResult, TextContent

from physment_mcp.serving.slot import CallLog
from tests.builders.laboratory import Command, OpenHost

BASE = "http://127.0.0.1"


async def opened(http: httpx.AsyncClient, max_calls: int) -> dict[str, str]:
    reply = await http.post("/episodes", json={"scene": 7, "max_calls": max_calls})
    assert reply.status_code == 201
    return reply.json()


async def log_of(http: httpx.AsyncClient, episode: dict[str, str], **query: Any) -> dict[str, Any]:
    reply = await http.get(f"/episodes/{episode['episode_id']}/calls", headers=owner(episode), params=query)
    assert reply.status_code == 200, reply.text
    return reply.json()


def owner(episode: dict[str, str]) -> dict[str, str]:
    return {"Authorization": f"Bearer {episode['owner_token']}"}


@contextlib.asynccontextmanager
async def client_of(http: httpx.AsyncClient, episode: dict[str, str]) -> AsyncGenerator[Client]:
    in_process: Any = http  # the SDK's own HTTP client has another name and the same methods
    async with Client(streamable_http_client(episode["mcp_url"], http_client=in_process)) as client:
        yield client


@pytest.mark.parametrize("shown_at", [(), (1,), (1, 5), (9,)])
def test_last_readings_outlast_the_calls_that_the_log_drops(shown_at: tuple[int, ...]) -> None:
    log = CallLog(kept=3)

    def add(tool: str, arguments: dict[str, Any], content: dict[str, Any]) -> None:
        text = TextContent(type="text", text=json.dumps(content))
        log.add(CallToolRequestParams(name=tool, arguments=arguments), CallToolResult(content=[text]), 0.0)
        if log.left_out + len(log.calls) in shown_at:
            log.readings()

    add("get_position", {"object_id": "object_1"}, {"sim_time": 0.5, "position": [1, 2, 3]})
    for _ in range(9):
        add("quat_to_rot_matrix", {"q": [1, 0, 0, 0]}, {"sim_time": 0.5})
    add("get_position", {"object_id": "object_2"}, {"sim_time": 0.7, "position": [4, 5, 6]})
    assert log.left_out == 8
    assert log.readings() == {
        "object_1": {"position": [1, 2, 3], "time": 0.5},
        "object_2": {"position": [4, 5, 6], "time": 0.7},
    }


async def test_the_log_holds_what_was_called_and_what_came_back(inside: OpenHost) -> None:
    async with inside() as (_, http):
        episode = await opened(http, 10)
        assert await log_of(http, episode) == {"ended": False, "calls": []}
        async with client_of(http, episode) as client:
            fell = await client.call_tool("step", {"duration": 0.5})
            refused = await client.call_tool("get_position", {"object_id": "nobody"})
            await client.call_tool("answer", {"answer": [1, "a"]})
        told = await log_of(http, episode)
        assert told["ended"]
        assert [(logged["tool"], logged["arguments"], logged["is_error"]) for logged in told["calls"]] == [
            ("step", {"duration": 0.5}, False),
            ("get_position", {"object_id": "nobody"}, True),
            ("answer", {"answer": [1, "a"]}, False),
        ]
        first, second, _last = told["calls"]
        assert (first["content"], first["text"]) == (fell.structured_content, fell.content[0].text)
        assert (second["content"], second["text"]) == (None, refused.content[0].text)
        assert all(logged["returned"] for logged in told["calls"])
        assert [logged["started_s"] for logged in told["calls"]] == sorted(
            logged["started_s"] for logged in told["calls"]
        )
        assert (await log_of(http, episode, start=2))["calls"] == told["calls"][2:]
        assert (await log_of(http, episode, start=3))["calls"] == []


async def test_a_call_beyond_the_limit_is_refused_and_not_logged(inside: OpenHost) -> None:
    async with inside() as (_, http):
        episode = await opened(http, 2)
        async with client_of(http, episode) as client:
            assert not (await client.call_tool("step", {"duration": 0.5})).is_error
            assert (await client.call_tool("get_position", {"object_id": "nobody"})).is_error  # counts too
            for tool, arguments in (("step", {"duration": 0.5}), ("answer", {"answer": 1}), ("fly", {})):
                late = await client.call_tool(tool, arguments)
                assert late.is_error
                assert late.content[0].text == (
                    "the episode is over: its 2 calls are used up and no further is possible"
                )
        told = await log_of(http, episode)
        assert told["ended"]
        assert [logged["tool"] for logged in told["calls"]] == ["step", "get_position"]


async def test_the_url_alone_neither_opens_the_log_nor_closes_the_episode(
    inside: OpenHost,
) -> None:
    async with inside() as (host, http):
        episode, other = await opened(http, 5), await opened(http, 5)
        path = f"/episodes/{episode['episode_id']}"
        assert episode["owner_token"] not in episode["mcp_url"]
        unauthorised: list[dict[str, str] | dict[bytes, bytes]] = [
            {},
            owner(other),
            {"Authorization": "Bearer "},
            {b"Authorization": "Bearer é".encode()},
        ]
        for headers in unauthorised:
            assert (await http.get(f"{path}/calls", headers=headers)).status_code == 401
            assert (await http.delete(path, headers=headers)).status_code == 401
        assert len(host._episodes) == 2
        assert (await http.delete(path, headers=owner(episode))).status_code == 204
        assert (await http.get(f"{path}/calls", headers=owner(episode))).status_code == 404


async def test_nothing_an_agent_can_read_names_the_token(inside: OpenHost) -> None:
    async with inside() as (_, http):
        episode = await opened(http, 5)
        async with client_of(http, episode) as client:
            said = str(client.instructions) + (await client.list_tools()).model_dump_json()
            said += (await client.get_prompt("scene", {})).model_dump_json()
            for resource in (await client.list_resources()).resources:
                said += (await client.read_resource(resource.uri)).model_dump_json()
            said += (await client.call_tool("step", {"duration": 0.1})).model_dump_json()
        assert "max_calls" in said
        assert episode["owner_token"] not in said


async def test_an_episode_opened_without_a_limit_has_no_log(inside: OpenHost) -> None:
    async with inside() as (_, http):
        episode = (await http.post("/episodes", json={"scene": 7})).json()
        assert "owner_token" not in episode
        assert (await http.get(f"/episodes/{episode['episode_id']}/calls")).status_code == 404
        assert (await http.delete(f"/episodes/{episode['episode_id']}")).status_code == 204


@pytest.mark.parametrize("limit", [0, -1, 10_001, "5", 2.5, True])
async def test_a_bad_limit_opens_nothing(inside: OpenHost, limit: object) -> None:
    async with inside() as (host, http):
        refused = await http.post("/episodes", json={"scene": 7, "max_calls": limit})
        assert refused.status_code == 400
        assert "max_calls" in refused.json()["error"]
        assert not host._episodes


@pytest.mark.parametrize("start", ["-1", "x", "1" * 5000, "٣x"])
async def test_a_bad_start_is_refused(inside: OpenHost, start: str) -> None:
    async with inside() as (_, http):
        episode = await opened(http, 5)
        path = f"/episodes/{episode['episode_id']}/calls"
        assert (await http.get(path, headers=owner(episode), params={"start": start})).status_code == 400


def test_numbers_that_json_does_not_know_leave_the_log_readable() -> None:
    log, arguments = CallLog(), {"duration": math.nan, "more": [math.inf, {"x": -math.inf}]}
    log.add(CallToolRequestParams(name="step", arguments=arguments), None, time.monotonic())
    (call,) = (json.loads(logged.as_json(), parse_constant=pytest.fail) for logged in log.calls)
    assert call["arguments"] == {"duration": "NaN", "more": ["Infinity", {"x": "-Infinity"}]}


async def test_a_cancelled_call_is_in_the_log_without_a_result(inside: OpenHost) -> None:
    async with inside() as (host, http):
        episode = await opened(http, 5)
        slot = host._episodes[episode["episode_id"]].slot
        with anyio.fail_after(120):
            async with client_of(http, episode) as client, anyio.create_task_group() as tasks:
                async with slot.turns.exclusive:
                    tasks.start_soon(client.call_tool, "step", {"duration": 60})
                    while not slot.turns.exclusive.statistics().tasks_waiting:
                        await anyio.lowlevel.checkpoint()
                while slot.session is not None and slot.session.calls == 0:
                    await anyio.lowlevel.checkpoint()
                tasks.cancel_scope.cancel()
            told = await log_of(http, episode)
        (call,) = told["calls"]
        assert (call["tool"], call["returned"], call["is_error"]) == ("step", False, False)
        assert (call["content"], call["text"]) == (None, "")


async def test_a_host_with_a_token_opens_episodes_only_for_requests_with_it(inside: OpenHost) -> None:
    async with inside(token="ours") as (host, http):
        for headers in ({}, {"Authorization": "Bearer theirs"}, {"Authorization": "Bearer "}):
            refused = await http.post("/episodes", json={"scene": 7}, headers=headers)
            assert refused.status_code == 401
            assert "token" in refused.json()["error"]
            assert "ours" not in refused.text
        assert not host._episodes
        assert "ours" not in repr(host)
        opened = await http.post("/episodes", json={"scene": 7}, headers={"Authorization": "Bearer ours"})
        assert opened.status_code == 201
        async with client_of(http, opened.json()) as client:  # the URL is enough to play
            assert not (await client.call_tool("step", {"duration": 0.1})).is_error


def test_an_empty_token_variable_is_a_usage_error(command: Command) -> None:
    words = command("serve", "--port", 0, "--token-env", "NO_SUCH_TOKEN")
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2
    assert done.stderr == "physment-mcp: --token-env NO_SUCH_TOKEN: this variable holds no token\n"
