"""The front of a host with several workers passes each connection to the worker of its first request, untouched."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field

import anyio
import pytest

from physment_mcp.serving import front as front_module
from physment_mcp.serving.front import Front


@dataclass
class Passing:
    """A front with three workers, which are played by the test."""

    address: tuple[str, int]
    workers: list[socket.socket]
    connections: list[socket.socket] = field(default_factory=list[socket.socket])

    def connect(self, first: bytes = b"") -> socket.socket:
        """A connection of a client, which sends its first bytes."""
        self.connections.append(connection := socket.create_connection(self.address, timeout=120))
        connection.sendall(first)
        return connection

    async def passed(self, first: bytes) -> tuple[int, bytes]:
        """The worker that gets a new connection, and the bytes that it reads."""
        self.connect(first)
        while True:
            await anyio.lowlevel.checkpoint()
            for number, worker in enumerate(self.workers):
                with contextlib.suppress(BlockingIOError):
                    _, passed, _, _ = socket.recv_fds(worker, 1, 1)
                    with socket.socket(fileno=passed[0]) as connection:
                        connection.settimeout(120)
                        return number, connection.recv(1000)


async def received(connection: socket.socket) -> bytes:
    return await anyio.to_thread.run_sync(connection.recv, 1)


@pytest.fixture
async def passing() -> AsyncGenerator[Passing]:
    with contextlib.ExitStack() as opened:
        listener = opened.enter_context(socket.create_server(("127.0.0.1", 0)))
        pairs = [socket.socketpair() for _ in range(3)]
        for one in (end for pair in pairs for end in pair):
            one.setblocking(False)
            opened.enter_context(one)
        front = Front(listener, [ours for ours, _ in pairs])
        made = Passing(listener.getsockname(), [theirs for _, theirs in pairs])
        running = asyncio.create_task(front.run())
        yield made
        running.cancel()
        await asyncio.wait([running])
        for connection in made.connections:
            connection.close()


@pytest.mark.parametrize("worker", [2, 0, 1])
@pytest.mark.parametrize(
    "line", [b"POST /episodes/w%d.abc/mcp HTTP/1.1\r\n", b"GET http://lab:80/episodes/w%d.abc/calls?start=0 HTTP/1.1"]
)
async def test_a_request_for_an_episode_goes_to_its_worker(passing: Passing, worker: int, line: bytes) -> None:
    assert await passing.passed(line % worker) == (worker, line % worker)


async def test_other_requests_go_to_the_workers_in_turn(passing: Passing) -> None:
    lines = [
        b"POST /episodes HTTP/1.1\r\n",
        b"GET /healthz",
        b"G",
        b"\0\xff",
        b"POST /episodes/w3.a/mcp",
        b"\r\n" * 600,
    ]
    taken = [await passing.passed(line) for line in lines]
    assert [worker for worker, _ in taken] == [0, 1, 2, 0, 1, 2]
    assert [line[:1000] for line in lines] == [line for _, line in taken]


async def test_a_connection_that_says_nothing_is_passed_to_nobody(
    passing: Passing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front_module, "REQUEST_S", 0.05)
    silent, left = passing.connect(), passing.connect()
    left.close()
    assert await received(silent) == b""
    assert (await passing.passed(b"GET / HTTP/1.1\r\n"))[0] == 0


async def test_more_silent_connections_than_the_bound_are_closed_at_once(
    passing: Passing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front_module, "_MOST_SILENT", 2)
    silent = [passing.connect() for _ in range(3)]
    assert await received(silent[2]) == b""
