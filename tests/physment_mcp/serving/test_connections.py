"""Tests that idle, slow, oversized or too many connections do not affect other clients."""

import asyncio
import contextlib
import logging
import re
import socket
import threading
import time
from collections.abc import Callable, Generator
from typing import Any, cast

import anyio
import pytest
import uvicorn
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from physment_mcp.serving.http_guard import Connections, HttpGuard, bounded_protocol
from physment_mcp.serving.listening import DeepBacklogServer
from physment_mcp.serving.scheduling import Scheduler

PATIENCE_S = 30.0
"""Longest wait of a test for an expected event [s]."""
Dial = Callable[[], socket.socket]


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    body = await Request(scope, receive).body()
    await PlainTextResponse(f"{len(body)} bytes")(scope, receive, send)


@contextlib.contextmanager
def served(connections: Connections, request_s: float = 0.3) -> Generator[Dial]:
    """Serve an application behind the guard on a free port; returns a function that connects to it."""
    listener = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(
        HttpGuard(echo, _at_once, names=["x"], most=1000, within_s=0.3),
        http=bounded_protocol(connections, request_s),
        log_config=None,
        lifespan="off",
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    opened: list[socket.socket] = []

    def dial() -> socket.socket:
        opened.append(socket.create_connection(listener.getsockname()[:2], timeout=PATIENCE_S))
        return opened[-1]

    try:
        while not server.started:
            time.sleep(0.01)
        yield dial
    finally:
        for connection in opened:
            connection.close()
        server.should_exit = True
        thread.join()


def reply(connection: socket.socket) -> bytes:
    """Read until the other side closes the connection."""
    received = b""
    with contextlib.suppress(ConnectionResetError):
        while part := connection.recv(4096):
            received += part
    return received


def ask(connection: socket.socket, body: bytes = b"abc") -> bytes:
    head = f"POST / HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: {len(body)}\r\n\r\n"
    connection.sendall(head.encode() + body)
    return reply(connection)


def test_a_request_within_the_bounds_is_served_and_its_connection_forgotten() -> None:
    connections = Connections(10, 10)
    with served(connections) as dial:
        for _ in range(30):
            assert ask(dial()).endswith(b"3 bytes")
    assert connections == Connections(10, 10)


@pytest.mark.parametrize("begun", [b"", b"POST / HTTP/1.1\r\nHo"])
def test_a_connection_without_a_complete_request_is_closed(begun: bytes) -> None:
    with served(Connections(10, 10)) as dial:
        idle = dial()
        idle.sendall(begun)
        assert reply(idle) == b""
        assert ask(dial()).endswith(b"3 bytes")


def _send_slowly(connection: socket.socket) -> None:
    """Send single bytes with pauses, until sending fails or `PATIENCE_S` have passed."""
    for _ in range(int(PATIENCE_S / 0.05)):
        connection.sendall(b"x")
        time.sleep(0.05)


def test_headers_that_come_drop_by_drop_are_not_waited_for() -> None:
    with served(Connections(10, 10)) as dial:
        slow = dial()
        slow.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nSlow: ")
        with pytest.raises((BrokenPipeError, ConnectionResetError)):
            _send_slowly(slow)


def test_a_second_request_on_a_connection_is_timed_too() -> None:
    with served(Connections(10, 10)) as dial:
        kept = dial()
        kept.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        received = b""
        while b"0 bytes" not in received:  # the response may arrive in pieces
            received += kept.recv(4096)
        kept.sendall(b"GET / HT")
        assert reply(kept) == b""


def test_a_body_that_does_not_come_is_answered_with_408() -> None:
    with served(Connections(10, 10)) as dial:
        slow = dial()
        slow.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: 10\r\n\r\nabc")
        assert reply(slow).startswith(b"HTTP/1.1 408")
        assert ask(dial()).endswith(b"3 bytes")


def test_a_body_that_is_too_large_is_answered_with_413() -> None:
    with served(Connections(10, 10)) as dial:
        assert ask(dial(), b"x" * 1000).endswith(b"1000 bytes")
        refused = ask(dial(), b"x" * 1001)
        assert refused.startswith(b"HTTP/1.1 413")
        assert b"a request has at most 1000 bytes" in refused


def test_requests_sent_ahead_are_answered_in_order_and_few_of_them_are_parsed_before_their_turn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waiting: list[int] = []
    begin = HttpToolsProtocol.on_message_begin

    def counted(self: HttpToolsProtocol) -> None:
        waiting.append(len(self.pipeline))
        begin(self)

    monkeypatch.setattr(HttpToolsProtocol, "on_message_begin", counted)
    many = 500
    ahead = b"".join(
        b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n%s" % (size, b"x" * size) for size in range(many)
    )
    with served(Connections(10, 10)) as dial:
        eager = dial()
        eager.sendall(ahead + b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        told = reply(eager)
    assert [int(size) for size in re.findall(rb"\r\n(\d+) bytes", told)] == [*range(many), 0]
    assert len(waiting) == many + 1
    assert max(waiting) <= 2048 // 40  # requests of 40 bytes in a read of 2048 bytes


def test_a_broken_off_upload_is_one_line_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    with served(Connections(10, 10), request_s=PATIENCE_S) as dial:
        upload = dial()
        upload.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 10\r\n\r\nabc")
        upload.close()
        until = time.monotonic() + PATIENCE_S
        while not caplog.records and time.monotonic() < until:
            time.sleep(0.01)
        assert ask(dial()).endswith(b"3 bytes")
    said = [record.getMessage() for record in caplog.records if record.name.startswith(("physment", "uvicorn.error"))]
    lines = [line for line in said if "upload" in line or "Exception" in line or "ASGI" in line]
    assert lines == ["an upload was broken off after 3 bytes"]


@pytest.mark.parametrize("limits", [(3, 10), (10, 3)])
def test_connections_beyond_the_limits_are_closed_and_warned_of_once(
    limits: tuple[int, int], caplog: pytest.LogCaptureFixture
) -> None:
    with served(Connections(*limits), request_s=PATIENCE_S) as dial:
        held = [dial() for _ in range(3)]
        for _ in range(5):
            assert reply(dial()) == b""
        held[0].close()
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:  # until the host has noticed
            with contextlib.suppress(ConnectionError):
                if ask(dial()).endswith(b"3 bytes"):
                    break
        else:
            pytest.fail("the place of a closed connection is not free again")
    warned = [record for record in caplog.records if "turned away" in record.getMessage()]
    assert len(warned) == 1


def test_places_are_counted_by_address() -> None:
    connections = Connections(4, 2)
    assert [connections.enter(address) for address in "aaabbc"] == [True, True, False, True, True, False]
    connections.leave("a")
    assert connections.enter("c")
    assert not connections.enter("c")


def test_few_connections_are_accepted_before_open_ones_are_looked_at_again() -> None:
    listener = socket.create_server(("127.0.0.1", 0), backlog=200)
    waiting = [socket.create_connection(listener.getsockname()[:2], timeout=PATIENCE_S) for _ in range(100)]
    accepted: list[int] = []

    class Counting(asyncio.Protocol):
        def __init__(self, **_: object) -> None:
            accepted[-1] += 1

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            cast("asyncio.Transport", transport).abort()

    config = uvicorn.Config(echo, http=Counting, backlog=8, log_config=None, lifespan="off")

    async def serve() -> None:
        server = DeepBacklogServer(config)
        config.load()
        server.lifespan = config.lifespan_class(config)
        await server.startup(sockets=[listener])
        until = time.monotonic() + PATIENCE_S
        while sum(accepted) < len(waiting) and time.monotonic() < until:
            accepted.append(0)
            await asyncio.sleep(0)
        server.servers[0].close()
        await asyncio.sleep(0)

    asyncio.run(serve())
    for connection in waiting:
        connection.close()
    assert sum(accepted) == len(waiting)
    assert max(accepted) <= 16


async def test_many_requests_outside_episodes_let_those_of_an_episode_pass() -> None:
    served: list[str] = []

    async def note(scope: Scope, _receive: Receive, _send: Send) -> None:
        served.append(scope["path"])

    scheduler = Scheduler()

    async def admit(path: str) -> None:
        if path != "/episode":
            await scheduler.enter()

    guard = HttpGuard(note, admit)

    async def ask(path: str) -> None:
        await guard(_scope(path), _no_body, _nothing)

    async with anyio.create_task_group() as tasks:
        for number in range(100):
            tasks.start_soon(ask, f"/outside/{number}")
        tasks.start_soon(ask, "/episode")
    # Requests outside episodes are admitted in their order; a request to an episode overtakes those that wait.
    assert served.index("/episode") <= 1
    assert [path for path in served if path != "/episode"] == [f"/outside/{number}" for number in range(100)]


async def test_a_request_that_takes_long_outside_episodes_keeps_no_other_out() -> None:
    opening, served = anyio.Event(), list[str]()

    async def open_or_note(scope: Scope, _receive: Receive, _send: Send) -> None:
        if scope["path"] == "/episodes":
            await opening.wait()
        served.append(scope["path"])

    scheduler = Scheduler()

    async def admit(_path: str) -> None:
        await scheduler.enter()

    guard = HttpGuard(open_or_note, admit)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(guard, _scope("/episodes"), _no_body, _nothing)
            await anyio.wait_all_tasks_blocked()
            await guard(_scope("/healthz"), _no_body, _nothing)
            opening.set()
    assert served == ["/healthz", "/episodes"]


async def _at_once(_path: str) -> None:
    """Admit every request."""


async def _nothing(*_: object) -> Any:
    return None


def _scope(path: str) -> Scope:
    return {"type": "http", "path": path, "headers": [(b"host", b"localhost")]}


async def _no_body() -> Message:
    return {"type": "http.request"}
