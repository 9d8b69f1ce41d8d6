"""Tests of episodes over sockets, for the program that started the host."""

import contextlib
import gc
import json
import socket
import subprocess
import weakref
from collections.abc import Callable, Generator, Mapping
from types import MappingProxyType
from typing import Any

import anyio
import pytest

from physment_mcp.serving.http_guard import MAX_BODY
from tests.builders.laboratory import Command, OpenHost

ENVELOPE = {
    "io.modelcontextprotocol/protocolVersion": "2026-07-28",
    "io.modelcontextprotocol/clientInfo": {"name": "test", "version": "1"},
    "io.modelcontextprotocol/clientCapabilities": {},
}
REQUEST = b'{"scene": 7}\n'


class Line:
    """The test's end of a socket; the host has the other end."""

    def __init__(self, control: socket.socket) -> None:
        self.socket, theirs = socket.socketpair()
        self.socket.setblocking(False)
        with theirs:
            socket.send_fds(control, [b"\n"], [theirs.fileno()])
        self.rest = b""

    async def send(self, line: bytes) -> None:
        while line:
            await anyio.wait_writable(self.socket)
            line = line[self.socket.send(line) :]

    async def receive(self) -> Any:
        """The next line as an object; None if the host has closed the socket."""
        while b"\n" not in self.rest:
            await anyio.wait_readable(self.socket)
            try:
                read = self.socket.recv(65536)
            except ConnectionResetError:
                read = b""
            if not read:
                return None
            self.rest += read
        line, _, self.rest = self.rest.partition(b"\n")
        return json.loads(line)

    async def ask(self, first: bytes) -> Any:
        await self.send(first)
        return await self.receive()


def call(number: int, tool: str, meta: Mapping[str, str] = MappingProxyType({}), /, **arguments: Any) -> bytes:
    params = {"name": tool, "arguments": arguments, "_meta": {**ENVELOPE, **meta}}
    return json.dumps({"jsonrpc": "2.0", "id": number, "method": "tools/call", "params": params}).encode() + b"\n"


@pytest.fixture
def control() -> Generator[tuple[Callable[[], Line], socket.socket]]:
    """Create the connections of episodes, and the control socket through which a host receives them."""
    ours, theirs = socket.socketpair()
    lines: list[Line] = []

    def new() -> Line:
        lines.append(Line(ours))
        return lines[-1]

    with ours, theirs:
        yield new, theirs
        for line in lines:
            line.socket.close()


async def episodes(http: Any) -> int:
    return (await http.get("/healthz")).json()["episodes"]


async def test_an_episode_is_opened_played_and_closed_with_its_socket(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs, token="theirs") as (host, http):
        first, second = new(), new()
        assert await first.ask(REQUEST) == await second.ask(REQUEST) == {"opened": True}
        assert await episodes(http) == 2
        session = weakref.ref(next(iter(host._sockets._open.values())))
        stepped = await first.ask(call(1, "step", duration=0.5))
        assert stepped["result"]["structuredContent"]["sim_time"] == 0.5
        untouched = await second.ask(call(1, "quat_to_rot_matrix", q=[1, 0, 0, 0]))
        assert untouched["result"]["structuredContent"]["sim_time"] == 0
        first.socket.shutdown(socket.SHUT_WR)
        assert await first.receive() is None  # closed only when the episode is gone
        assert await episodes(http) == 1
        second.socket.close()
        while await episodes(http):
            await anyio.lowlevel.checkpoint()
        gc.collect()
        assert session() is None


@pytest.mark.parametrize(
    ("request_line", "status", "word"),
    [
        (b'{"scene": 99}\n', 404, "no scene 99"),
        (b"{}\n", 400, "scene: Field required"),
        (b"nonsense\n", 400, "body: Invalid JSON"),
    ],
)
async def test_a_request_that_opens_nothing_is_told_why_and_takes_no_place(
    control: Any, inside: OpenHost, request_line: bytes, status: int, word: str
) -> None:
    new, theirs = control
    async with inside(control=theirs, max_episodes=1, token="theirs") as (_, _http):
        for _ in range(2):
            line = new()
            refused = await line.ask(request_line)
            assert refused["status"] == status
            assert word in refused["error"]
            assert await line.receive() is None
        assert await new().ask(REQUEST) == {"opened": True}


async def test_episodes_on_sockets_and_over_http_share_one_limit(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs, max_episodes=1) as (_, http):
        line = new()
        assert await line.ask(REQUEST) == {"opened": True}
        assert (await http.post("/episodes", json={"scene": 7})).status_code == 429
        line.socket.shutdown(socket.SHUT_WR)
        assert await line.receive() is None
        assert (await http.post("/episodes", json={"scene": 7})).status_code == 201
        assert (await new().ask(REQUEST))["status"] == 429


@pytest.mark.parametrize("line", [b"x" * (MAX_BODY + 1) + b"\n", b"x" * 4 * MAX_BODY])
async def test_a_line_that_is_too_long_ends_its_episode_and_no_other(
    control: Any, inside: OpenHost, line: bytes
) -> None:
    new, theirs = control
    async with inside(control=theirs) as (_, http):
        greedy, honest = new(), new()
        assert await greedy.ask(REQUEST) == await honest.ask(REQUEST) == {"opened": True}
        with contextlib.suppress(ConnectionResetError, BrokenPipeError):
            await greedy.send(line)
        assert await greedy.receive() is None
        assert await episodes(http) == 1
        assert (await honest.ask(call(1, "step", duration=0.1)))["result"]["structuredContent"]["steps"] == 20


async def test_what_is_no_message_is_skipped(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs) as (_, _http):
        line = new()
        assert await line.ask(REQUEST) == {"opened": True}
        await line.send(b"\n\xff\n{}\n[1]\n")
        assert (await line.ask(call(1, "step", duration=0.1)))["id"] == 1


async def test_a_call_of_more_than_20_kb_is_refused_as_over_http(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs) as (_, _http):
        line = new()
        assert await line.ask(REQUEST) == {"opened": True}
        refused = (await line.ask(call(1, "answer", answer="x" * 30_000)))["result"]
        assert refused["isError"]
        assert "20000 bytes" in refused["content"][0]["text"]


async def test_an_unused_episode_expires_and_one_in_use_does_not(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs, idle_timeout_s=0.1) as (host, http):
        busy = new()
        assert await busy.ask(REQUEST) == {"opened": True}
        next(iter(host._sockets._open)).in_flight += 1
        idle = new()
        assert await idle.ask(REQUEST) == {"opened": True}
        assert await idle.receive() is None
        assert await episodes(http) == 1
        assert (await busy.ask(call(1, "step", duration=0.1)))["id"] == 1


async def test_the_requests_of_an_episode_are_served_in_their_order(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs) as (_, _http):
        line = new()
        assert await line.ask(REQUEST) == {"opened": True}
        await line.send(b"".join(call(number, "step", duration=0.1) for number in range(20)))
        replies = [await line.receive() for _ in range(20)]
        assert [reply["id"] for reply in replies] == list(range(20))
        times = [reply["result"]["structuredContent"]["sim_time"] for reply in replies]
        assert times == pytest.approx([0.1 * number for number in range(1, 21)])


async def test_a_cancelled_call_changes_nothing_and_frees_the_episode(control: Any, inside: OpenHost) -> None:
    new, theirs = control
    async with inside(control=theirs) as (_, _http):
        line = new()
        assert await line.ask(REQUEST) == {"opened": True}
        begun = await line.ask(call(1, "step", {"progressToken": "p"}, duration=60))
        assert begun["method"] == "notifications/progress"
        cancel = {"jsonrpc": "2.0", "method": "notifications/cancelled", "params": {"requestId": 1, "_meta": ENVELOPE}}
        await line.send(json.dumps(cancel).encode() + b"\n" + call(2, "step", duration=0.5))
        while "id" not in (reply := await line.receive()):
            assert reply["method"] == "notifications/progress"
        assert reply["id"] == 2
        assert reply["result"]["structuredContent"]["sim_time"] == 0.5


@pytest.mark.parametrize("number", ["999", "-1", "1"])
def test_a_descriptor_that_is_no_socket_is_refused_in_one_sentence(command: Command, number: str) -> None:
    done = subprocess.run(
        command("serve", "--port", 0, f"--control-fd={number}"),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 2
    assert done.stderr == f"physment-mcp: --control-fd {number}: is not the descriptor of an open Unix socket\n"
