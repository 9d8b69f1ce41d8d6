"""Tests of the client that the integrations share: one POST per call, the same results as an MCP client, no lost
episode.
"""

import json
import math
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, closing
from typing import Any

import httpx
import httpx2
import pytest

from evaluator.episode.hosts import mcp_client
from physment_mcp.contract.names import GONE
from tests.builders.referee_client import laboratory_client

WebServer = Callable[[int, bytes], AbstractContextManager[str]]


@pytest.fixture
def opened(host_url: str) -> dict[str, Any]:
    """Open an episode that requires a player token; return the host's reply."""
    return httpx.post(f"{host_url}/episodes", json={"scene": 7, "seed": 3, "guarded": True, "max_calls": 100}).json()


@pytest.fixture
def laboratory(opened: dict[str, Any]) -> Generator[Any]:
    """Yield the client's connection to this episode, with its player token."""
    with closing(laboratory_client().Laboratory(opened["mcp_url"], opened["player_token"])) as connected:
        yield connected


async def test_a_call_returns_what_an_mcp_client_reads(opened: dict[str, Any], laboratory: Any) -> None:
    moved = laboratory.call("step", {"duration": 0.1})
    mine = laboratory.call("get_position", {"object_id": "object_1"})
    headers = {"Authorization": f"Bearer {opened['player_token']}"}
    async with httpx2.AsyncClient(headers=headers) as http, mcp_client(opened["mcp_url"], http) as client:
        theirs = await client.call_tool("get_position", {"object_id": "object_1"})
    assert not moved.is_error
    assert (mine.content, mine.text) == (theirs.structured_content, theirs.content[0].text)  # type: ignore[union-attr] - a text
    assert json.loads(mine.text) == mine.content


def test_what_an_agent_does_wrong_is_said_in_words_and_leaves_the_episode_playable(laboratory: Any) -> None:
    wrong: list[tuple[str, dict[str, Any], str]] = [
        ("get_position", {"object_id": "object_99"}, "object_99"),
        ("step", {"duration": "long"}, "duration"),
        ("step", {"duration": math.nan}, "duration"),
        ("lift", {}, "lift"),
        ("lift\r\nX-Evil: 1", {}, "lift"),
        ("h\u00f6her", {"a": 1}, "h\u00f6her"),
        ("\ud800", {}, ""),
        ("step", {"duration": 0.1, "note": "x" * 5_000_000}, "bytes"),
    ]
    for tool, arguments, says in wrong:
        called = laboratory.call(tool, arguments)
        assert (called.is_error, called.content) == (True, None)
        assert says in called.text, called.text
    assert laboratory.call("step", {"duration": 0.1}).content["sim_time"] == pytest.approx(0.1)


def test_a_host_that_lost_the_episode_is_no_fault_of_the_agent(
    opened: dict[str, Any], laboratory: Any, web_server: WebServer
) -> None:
    module = laboratory_client()
    assert module.GONE == GONE
    laboratory.call("step", {"duration": 0.1})
    owner = {"Authorization": f"Bearer {opened['owner_token']}"}
    assert httpx.delete(opened["mcp_url"].removesuffix("/mcp"), headers=owner).status_code == 204
    with pytest.raises(module.LaboratoryError, match=r"no longer has the episode|the host failed"):
        laboratory.call("step", {"duration": 0.1})
    with pytest.raises(module.LaboratoryError, match="cannot be reached"):
        module.Laboratory("http://127.0.0.1:9/mcp", "t").call("step", {})
    with (
        web_server(502, b"<html>") as url,
        closing(module.Laboratory(url, "t")) as broken,
        pytest.raises(module.LaboratoryError, match="it answered 502"),
    ):
        broken.call("step", {})


def test_a_wrong_token_is_no_result(opened: dict[str, Any]) -> None:
    module = laboratory_client()
    with (
        closing(module.Laboratory(opened["mcp_url"], "wrong")) as foreign,
        pytest.raises(module.LaboratoryError, match="bearer token"),
    ):
        foreign.call("step", {"duration": 0.1})


def test_an_idle_connection_is_opened_anew(laboratory: Any) -> None:
    laboratory.call("step", {"duration": 0.1})
    first = laboratory._connection.sock
    laboratory.call("step", {"duration": 0.1})
    assert laboratory._connection.sock is first
    laboratory._used_at -= 2 * laboratory_client().IDLE_S
    assert laboratory.call("step", {"duration": 0.1}).content["sim_time"] == pytest.approx(0.3)
    assert laboratory._connection.sock is not first


def test_the_last_event_of_a_stream_is_the_result() -> None:
    reply = {
        "jsonrpc": "2.0",
        "id": 1,
        "result": {"content": [{"type": "text", "text": "{}"}], "structuredContent": {}},
    }
    body = b": ping\r\n\r\nevent: message\r\ndata: " + json.dumps(reply).encode() + b"\r\n\r\n"
    assert laboratory_client().result_of(200, body) == laboratory_client().CallResult("{}", {}, False)
