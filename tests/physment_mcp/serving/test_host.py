"""Tests of many episodes over HTTP, each with its own address, for every kind of client."""

import contextlib
import gc
import json
import socket
import subprocess
import sys
import weakref
from collections.abc import Callable, Generator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import anyio
import httpx
import pytest
from mcp import Client

from physment_mcp.serving import episode_server
from physment_mcp.serving.http_guard import MAX_BODY
from tests.builders.laboratory import Command, OpenHost, WritePack

BASE = "http://127.0.0.1"
ACCEPT = {"Accept": "application/json, text/event-stream"}
HELLO = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "test", "version": "1"},
    },
}


@contextlib.contextmanager
def serving(command: list[str], cwd: Path) -> Generator[str]:
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=cwd, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["listening"]
        finally:
            process.terminate()
            rest, errors = process.communicate(timeout=300)
    assert rest == ""
    assert "Traceback" not in errors


@pytest.fixture
def started(
    command: Command, write_pack: WritePack, pack: dict[str, Any], xml: str, tmp_path: Path
) -> Callable[..., Any]:
    folder = write_pack(pack, xml)
    work = tmp_path / "work"
    work.mkdir()
    return lambda *options: serving(command("serve", "--port", 0, "--scenes-dir", folder, *options), work)


async def test_both_protocol_eras_and_reconnecting_clients_reach_the_same_episode(started: Callable[..., Any]) -> None:
    with started() as base, anyio.fail_after(120):
        async with httpx.AsyncClient(base_url=base) as http:
            reply = await http.post("/episodes", json={"scene": 7, "seed": 12345})
            assert reply.status_code == 201
            opened, other = reply.json(), (await http.post("/episodes", json={"scene": 7})).json()
            assert opened.keys() == {"episode_id", "mcp_url", "expires_at"}
            assert opened["mcp_url"] == f"{base}/episodes/{opened['episode_id']}/mcp"
            assert datetime.fromisoformat(opened["expires_at"]) > datetime.now(UTC)
            assert "12345" not in reply.text
            assert len(opened["episode_id"]) >= 22  # 16 bytes or more of randomness
            assert opened["episode_id"] != other["episode_id"]
            versions = set()
            for turn, mode in enumerate(("auto", "legacy", "auto", "legacy"), 1):
                async with Client(opened["mcp_url"], mode=mode) as client:
                    versions.add(client.protocol_version)
                    assert "# Scene: All kinds" in (client.instructions or "")
                    assert len((await client.list_tools()).tools) == 26
                    stepped = await client.call_tool("step", {"duration": 0.5})
                    assert stepped.structured_content == {
                        "sim_time": 0.5 * turn, "steps": 100, "lab_time_left": 3600 - 0.5 * turn, "calls_left": None,
                        "results": None,
                    }  # fmt: skip
            assert len(versions) == 2
            async with Client(opened["mcp_url"]) as first, Client(opened["mcp_url"], mode="legacy") as second:
                await first.call_tool(
                    "create_objects", {"name": "p", "pos": [0, 9, 9], "density": 1, "rgba": [1, 1, 1, 1]}
                )
                assert not (await second.call_tool("get_position", {"object_id": "p"})).is_error
                await second.call_tool("answer", {"answer": 1})
                assert (await first.call_tool("step", {"duration": 1})).is_error
            async with Client(other["mcp_url"]) as client:  # untouched
                started_at = await client.call_tool("quat_to_rot_matrix", {"q": [1, 0, 0, 0]})
                assert started_at.structured_content["sim_time"] == 0
            assert (await http.get("/healthz")).json() == {"status": "ok", "episodes": 2}
            assert (await http.delete(f"/episodes/{opened['episode_id']}")).status_code == 204
            assert (await http.delete(f"/episodes/{opened['episode_id']}")).status_code == 404
            assert (await http.get("/healthz")).json()["episodes"] == 1


async def test_an_unused_episode_expires_and_makes_room(started: Callable[..., Any]) -> None:
    with started("--idle-timeout", "0.2", "--max-episodes", "1") as base, anyio.fail_after(120):
        async with httpx.AsyncClient(base_url=base) as http:
            url = (await http.post("/episodes", json={"scene": 7})).json()["mcp_url"]
            while (await http.get("/healthz")).json()["episodes"]:
                await anyio.lowlevel.checkpoint()
            async with Client(url) as client:
                gone = await client.call_tool("step", {"duration": 1})
            assert gone.is_error
            assert "has expired" in gone.content[0].text
            assert (await http.post("/episodes", json={"scene": 7})).status_code == 201


async def test_simultaneous_requests_do_not_exceed_the_limit_of_episodes(inside: OpenHost) -> None:
    codes: list[int] = []
    async with inside(max_episodes=3) as (_, http):

        async def post() -> None:
            codes.append((await http.post("/episodes", json={"scene": 7})).status_code)

        async with anyio.create_task_group() as tasks:
            for _ in range(8):
                tasks.start_soon(post)
        assert sorted(codes) == [201] * 3 + [429] * 5
        assert (await http.get("/healthz")).json()["episodes"] == 3
        full = await http.post("/episodes", json={"scene": 7})
        assert "3 episodes are open" in full.json()["error"]


async def test_a_scene_that_fails_to_open_does_not_count_towards_the_limit(inside: OpenHost) -> None:
    async with inside(max_episodes=1) as (_, http):
        for _ in range(3):
            assert (await http.post("/episodes", json={"scene": 99})).status_code == 404
        assert (await http.post("/episodes", json={"scene": 7})).status_code == 201


@pytest.mark.parametrize(
    ("body", "status", "word"),
    [
        (b'{"scene": 99}', 404, "no scene 99"),
        (b"", 400, "scene"),
        (b"{", 400, "JSON"),
        (b"[]", 400, "body"),
        (b'{"seed": 1}', 400, "scene"),
        (b'{"scene": "7"}', 400, "scene"),
        (b'{"scene": true}', 400, "scene"),
        (b'{"scene": 7.5}', 400, "scene"),
        (b'{"scene": %s}' % (b"9" * 4000), 400, "scene"),
        (b'{"scene": 7, "seed": -%s}' % (b"9" * 4000), 400, "seed"),
        (b'{"scene": 7, "seed": "x"}', 400, "seed"),
        (b'{"scene": 7, "answer": 1}', 400, "answer"),
        (b'{"scene": 7, "pad": "' + b"x" * MAX_BODY + b'"}', 413, ""),
    ],
)
async def test_a_bad_request_opens_nothing(
    inside: OpenHost, tmp_path: Path, body: bytes, status: int, word: str
) -> None:
    async with inside() as (host, http):
        reply = await http.post("/episodes", content=body)
        assert reply.status_code == status
        assert word in reply.text
        assert str(tmp_path) not in reply.text
        assert not host._episodes


async def test_a_deleted_episode_makes_room_and_is_gone(inside: OpenHost) -> None:
    async with inside(max_episodes=1) as (_, http):
        opened = (await http.post("/episodes", json={"scene": 7})).json()
        assert (await http.delete(f"/episodes/{opened['episode_id']}")).status_code == 204
        assert (await http.post("/episodes", json={"scene": 7})).status_code == 201


async def test_a_large_body_is_refused_by_an_episode_too(inside: OpenHost) -> None:
    async with inside() as (_, http):
        url = (await http.post("/episodes", json={"scene": 7})).json()["mcp_url"]
        assert (await http.post(url, content=b"x" * (MAX_BODY + 1))).status_code == 413


@pytest.mark.parametrize("name", ["evil.example", "127.0.0.1.evil.example", "10.0.0.1"])
async def test_a_request_to_another_host_name_is_refused(inside: OpenHost, name: str) -> None:
    async with inside() as (host, http):
        refused = await http.post("/episodes", json={"scene": 7}, headers={"Host": name})
        assert refused.status_code == 400
        assert (await http.get("/healthz", headers={"Host": name})).status_code == 400
        assert not host._episodes


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/episodes", 405), ("GET", "/", 404), ("POST", "/episodes/x/mcp", 400), ("PUT", "/episodes/x/mcp", 405),
        ("DELETE", "/episodes/x", 404), ("GET", "/episodes/x", 405), ("POST", "/healthz", 405), ("GET", "/docs", 404),
    ],
)  # fmt: skip
async def test_other_paths_and_methods_are_refused(inside: OpenHost, method: str, path: str, status: int) -> None:
    async with inside() as (_, http):
        assert (await http.request(method, path)).status_code == status


async def test_closing_the_host_closes_its_episodes(inside: OpenHost) -> None:
    with anyio.fail_after(120):
        async with inside() as (host, http):
            urls = [(await http.post("/episodes", json={"scene": 7})).json()["mcp_url"] for _ in range(3)]
            assert [(await http.post(url, json=HELLO, headers=ACCEPT)).status_code for url in urls] == [200] * 3
    # The application still exists, but its episodes are closed: none of them serves another request.
    async with httpx.AsyncClient(transport=httpx.ASGITransport(host.app()), base_url=BASE) as late:
        for url in urls:
            with pytest.raises(RuntimeError, match="not initialized"):
                await late.post(url, json=HELLO, headers=ACCEPT)


async def test_an_episode_in_use_does_not_expire(inside: OpenHost) -> None:
    async with inside(idle_timeout_s=0.05) as (host, _):
        busy = await host.open_episode(b'{"scene": 7}')
        await host.open_episode(b'{"scene": 7}')
        host._episodes[busy].in_flight += 1
        with anyio.fail_after(120):
            while len(host._episodes) > 1:
                await anyio.lowlevel.checkpoint()
        assert list(host._episodes) == [busy]


@pytest.mark.parametrize("port", ["99999", "-1", "http"])
def test_a_bad_port_is_refused_with_the_usage(port: str) -> None:
    command = [sys.executable, "-m", "physment_mcp", "serve", f"--port={port}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2
    assert "is not a port; ports are 0 to 65535" in done.stderr


def test_a_port_in_use_is_refused_in_one_sentence() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "physment_mcp", "serve", f"--port={port}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"physment-mcp: cannot listen on 127.0.0.1 port {port}: ")
    assert len(done.stderr.splitlines()) == 1


def test_white_space_after_a_header_value_is_ignored(started: Callable[..., Any]) -> None:
    with started() as base:
        address = httpx.URL(base)
        with socket.create_connection((address.host, address.port or 80), timeout=300) as line:
            line.sendall(
                f"GET /healthz HTTP/1.1\r\nHost: {address.netloc.decode()} \t\r\nConnection: close\r\n\r\n".encode()
            )
            assert b" 200 " in line.makefile("rb").readline()


async def test_an_episode_that_is_closed_frees_its_memory_without_the_garbage_collector(inside: OpenHost) -> None:
    async with inside() as (host, http):
        opened = (await http.post("/episodes", json={"scene": 7})).json()
        session = host._episodes[opened["episode_id"]].slot.session
        assert session is not None
        world = weakref.ref(session.world)
        del session
        gc.disable()
        try:
            assert (await http.delete(f"/episodes/{opened['episode_id']}")).status_code == 204
            with anyio.fail_after(60):  # the thread that opened the episode may still refer to it
                while world() is not None:  # noqa: ASYNC110 - no event reports it
                    await anyio.sleep(0.01)
        finally:
            gc.enable()


async def test_a_log_that_is_read_while_its_episode_is_closed_is_complete(inside: OpenHost) -> None:
    async with inside() as (host, http):
        opened = (await http.post("/episodes", json={"scene": 7, "max_calls": 5})).json()
        path, owner = f"/episodes/{opened['episode_id']}", {"Authorization": f"Bearer {opened['owner_token']}"}
        replies: list[httpx.Response] = []

        async def read() -> None:
            replies.append(await http.get(f"{path}/calls", headers=owner))

        async with anyio.create_task_group() as tasks, host._episodes[opened["episode_id"]].slot.turns.exclusive:
            tasks.start_soon(read)
            await anyio.wait_all_tasks_blocked()
            assert (await http.delete(path, headers=owner)).status_code == 204
        assert replies[0].json() == {"ended": False, "calls": []}


async def test_an_episode_has_a_bounded_number_of_sessions(inside: OpenHost, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episode_server, "_SESSIONS", 2)
    async with inside() as (_, http):
        path = httpx.URL((await http.post("/episodes", json={"scene": 7})).json()["mcp_url"]).path
        replies = [await http.post(path, json=HELLO, headers=ACCEPT) for _ in range(3)]
        assert [reply.status_code for reply in replies] == [200, 200, 503]
        ended = {"Mcp-Session-Id": replies[0].headers["mcp-session-id"], **ACCEPT}
        assert (await http.delete(path, headers=ended)).status_code == 200
        assert (await http.post(path, json=HELLO, headers=ACCEPT)).status_code == 200
