"""Attacks of a hostile client on a host, one function for each kind. Each runs until it is cancelled.

python -m tests.harness.load.attacks PORT KIND    attacks until its stdin ends, then prints what it sent

Sends bytes over connections. Measures nothing.
"""

import asyncio
import contextlib
import itertools
import json
import os
import random
import sys
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field

from tests.harness.load.wire import Connection, call, message, opened, posted, raw_call, request

_AT_ONCE = 4
"""Number of connections over which an attack sends requests in sequence."""
_MANY = 200
"""Number of connections of attacks that only hold connections open."""
_HEAVY_SCENE = 99
"""The scene of the suite whose steps take the longest."""
_LOW_PRIORITY = 10
"""Niceness of an attacker, so that it loads the host without taking processor time from the honest clients."""
_HELLO = {"protocolVersion": "2025-11-25", "capabilities": {}, "clientInfo": {"name": "load", "version": "1"}}
_PROMPT = {"name": "scene", "arguments": {"prompting": "few-shot-cot"}}
_SESSION_HEADERS = {"Accept": "application/json, text/event-stream", "Content-Type": "application/json"}
_CLOSED = (OSError, asyncio.IncompleteReadError)
"""Exceptions that are raised when the host closes a connection."""


@dataclass
class Target:
    """The attacked host, with counts of sent and refused requests."""

    port: int
    sent: int = 0
    """Complete requests, or connections where no request is complete."""
    sent_bytes: int = 0
    refused: int = 0
    """Responses with a status of 400 or above, and connections that the host closed."""
    begun: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when all preparations are done."""

    async def send(self, connection: Connection, content: bytes) -> bool:
        """Send a request and read the response; returns whether the response is a result."""
        self.sent += 1
        self.sent_bytes += len(content)
        reply = await connection.ask(content)
        self.refused += reply.status >= 400
        return not reply.failed

    async def throw(self, connection: Connection, content: bytes) -> None:
        """Send bytes without reading a response."""
        self.sent_bytes += len(content)
        connection.writer.write(content)
        await connection.writer.drain()

    async def connecting(self, use: Callable[[Connection], Awaitable[None]]) -> None:
        """Open one connection after another; each lasts until `use` returns or the host closes it."""
        while True:
            try:
                connection = await Connection.dial(self.port)
            except OSError:
                self.refused += 1
                continue
            try:
                await use(connection)
            except _CLOSED:
                self.refused += 1
            finally:
                connection.abort()


Attack = Callable[[Target], Awaitable[None]]


async def side_by_side(count: int, run: Callable[[], Awaitable[None]]) -> None:
    """Run a coroutine function `count` times concurrently."""
    await asyncio.gather(*(run() for _ in range(count)))


def repeated(make: Callable[[str], Iterable[bytes]], at_once: int = _AT_ONCE) -> Attack:
    """Create an attack that repeats requests.

    Args:
        make: Function that returns the requests for the path of an episode.
        at_once: Number of connections.
    """

    async def attack(target: Target) -> None:
        contents = list(make((await opened(target.port))["path"]))
        target.begun.set()

        async def use(connection: Connection) -> None:
            for content in itertools.cycle(contents):
                await target.send(connection, content)

        await side_by_side(at_once, lambda: target.connecting(use))

    return attack


def _wrong_urls(path: str) -> Iterable[bytes]:
    nobody = path.replace(path.split("/")[2], "nobody")
    yield request("GET", "/nothing")
    yield request("GET", "/episodes/" + "x" * 5000)
    yield call(nobody, "step", duration=1)
    yield request("DELETE", nobody.removesuffix("/mcp"))
    yield request("PUT", path)
    yield posted(path, b"{", "tools/call", "step")


def _refused_openings(_path: str) -> Iterable[bytes]:
    for body in (b'{"scene": 4}', b'{"scene": "7"}', b"{", b'{"scene": 7, "' + b"x" * 20_000 + b'": 1}'):
        yield request("POST", "/episodes", body)


async def long_steps(target: Target) -> None:
    """Call `step` again and again, each time for one minute of simulated time; open a new episode at the time limit."""
    target.begun.set()

    async def use(connection: Connection) -> None:
        episode = await opened(target.port, _HEAVY_SCENE)
        while await target.send(connection, call(episode["path"], "step", duration=60)):
            pass
        await target.send(connection, request("DELETE", f"/episodes/{episode['episode_id']}"))

    await target.connecting(use)


async def _filled(target: Target, calls: int, max_calls: int | None = None) -> dict[str, str]:
    """Open an episode, and make calls until its log contains this many."""
    episode = await opened(target.port, max_calls=max_calls)
    connection = await Connection.dial(target.port)
    for _ in range(calls):
        await target.send(connection, call(episode["path"], "get_parameters", object_id="object_1"))
    connection.close()
    target.begun.set()
    return episode


async def measurements(target: Target) -> None:
    """Read the largest possible pages of measurements."""
    episode, uri = await _filled(target, 500), "physment://measurements"
    page = message(episode["path"], "resources/read", {"uri": uri}, uri)

    async def use(connection: Connection) -> None:
        while True:
            await target.send(connection, page)

    await side_by_side(_AT_ONCE, lambda: target.connecting(use))


async def call_log(target: Target) -> None:
    """Read pages of the call log as the owner of the episode."""
    episode = await _filled(target, 500, max_calls=10_000)
    owner = {"Authorization": f"Bearer {episode['owner_token']}"}
    page = request("GET", f"/episodes/{episode['episode_id']}/calls", headers=owner)

    async def use(connection: Connection) -> None:
        while True:
            await target.send(connection, page)

    await side_by_side(_AT_ONCE, lambda: target.connecting(use))


async def broken_off(target: Target) -> None:
    """Start long steps and disconnect."""
    path = (await opened(target.port, _HEAVY_SCENE))["path"]
    target.begun.set()

    async def use(connection: Connection) -> None:
        target.sent += 1
        await target.throw(connection, call(path, "step", duration=60))
        await asyncio.sleep(0.02)

    await side_by_side(_AT_ONCE, lambda: target.connecting(use))


async def slow_uploads(target: Target) -> None:
    """Send bodies a byte at a time."""
    path = (await opened(target.port))["path"]
    head = call(path, "step", duration=1).partition(b"\r\n\r\n")[0] + b"\r\n\r\n"
    target.begun.set()

    async def use(connection: Connection) -> None:
        target.sent += 1
        await target.throw(connection, head)
        while not connection.reader.at_eof():
            await target.throw(connection, b" ")
            await asyncio.sleep(0.1)

    await side_by_side(_MANY, lambda: target.connecting(use))


async def half_open(target: Target) -> None:
    """Open connections and send nothing, or a part of the first line."""
    target.begun.set()

    async def use(connection: Connection) -> None:
        target.sent += 1
        await target.throw(connection, b"POST /epis" * (target.sent % 2))
        await connection.reader.read()

    await side_by_side(3 * _MANY, lambda: target.connecting(use))


async def slow_readers(target: Target) -> None:
    """Ask for long responses and read them slowly."""
    path = (await opened(target.port))["path"]
    target.begun.set()

    async def use(connection: Connection) -> None:
        # The receive buffer of the system would take in many responses.
        connection.reader._limit = 1024  # type: ignore[attr-defined]
        for _ in range(50):
            target.sent += 1
            await target.throw(connection, message(path, "tools/list"))
        await asyncio.sleep(0.1)
        while await connection.reader.read(256):  # noqa: ASYNC110 - reads slowly, waits for nothing
            await asyncio.sleep(0.1)

    await side_by_side(_MANY // 4, lambda: target.connecting(use))


async def garbage(target: Target) -> None:
    """Send bytes that are not HTTP."""
    noise = random.Random(1)
    target.begun.set()

    async def use(connection: Connection) -> None:
        target.sent += 1
        await target.throw(connection, noise.choice([noise.randbytes(1000), b"GET / HTTP/9\r\n\r\n", b"\0" * 100]))
        while await connection.reader.read(1000):
            pass

    await side_by_side(_AT_ONCE, lambda: target.connecting(use))


async def sessions(target: Target) -> None:
    """Open sessions of the older protocol and never close them."""
    path = (await opened(target.port))["path"]
    target.begun.set()

    async def use(connection: Connection) -> None:
        while True:
            await target.send(connection, _hello(path))

    await side_by_side(_AT_ONCE, lambda: target.connecting(use))


async def streams(target: Target) -> None:
    """Keep streams for server messages open, each in a separate session."""
    path = (await opened(target.port))["path"]
    target.begun.set()

    async def use(connection: Connection) -> None:
        target.sent += 1
        session = (await connection.ask(_hello(path))).headers["mcp-session-id"]
        await target.throw(connection, request("GET", path, headers={**_SESSION_HEADERS, "Mcp-Session-Id": session}))
        await connection.reader.read()

    await side_by_side(_MANY // 2, lambda: target.connecting(use))


def _hello(path: str) -> bytes:
    body = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": _HELLO}
    return request("POST", path, json.dumps(body).encode(), _SESSION_HEADERS)


async def openings(target: Target) -> None:
    """Open episodes and close them."""
    target.begun.set()

    async def use(connection: Connection) -> None:
        while True:
            target.sent += 1
            reply = await connection.ask(request("POST", "/episodes", json.dumps({"scene": _HEAVY_SCENE}).encode()))
            await target.send(connection, request("DELETE", f"/episodes/{json.loads(reply.body)['episode_id']}"))

    await target.connecting(use)


def _text(length: int) -> Callable[[str], Iterable[bytes]]:
    return lambda path: [call(path, "get_position", object_id="x" * length)]


ATTACKS: dict[str, Attack] = {
    "calls of just under 20 kB": repeated(_text(19_900)),
    "calls of 60 kB": repeated(_text(60_000)),
    "calls of 1 MB": repeated(_text(1_000_000)),
    "lists of 10,000 items": repeated(lambda path: [raw_call(path, f'{{"q": {[0] * 10_000}}}')]),
    "900 levels of nesting": repeated(lambda path: [raw_call(path, f'{{"q": {"[" * 900}{"]" * 900}}}')]),
    "names of tools of 10 kB": repeated(lambda path: [raw_call(path, "{}", "x" * 10_000)]),
    "tools/list": repeated(lambda path: [message(path, "tools/list")]),
    "prompts": repeated(lambda path: [message(path, "prompts/get", _PROMPT, "scene")]),
    "pages of measurements": measurements,
    "pages of the log": call_log,
    "steps of 60 s": long_steps,
    "steps of 60 s broken off": broken_off,
    "200 requests at once": repeated(
        lambda path: [call(path, "step", duration=0.1), call(path, "get_position", object_id="object_1")], _MANY
    ),
    "slow uploads": slow_uploads,
    "half-open connections": half_open,
    "slow readers": slow_readers,
    "garbage": garbage,
    "wrong URLs": repeated(_wrong_urls),
    "200 wrong URLs at once": repeated(_wrong_urls, _MANY),
    "200 refused openings at once": repeated(_refused_openings, _MANY),
    "sessions never ended": sessions,
    "streams kept open": streams,
    "episodes opened and closed": openings,
}
"""Kind → the attack."""


async def _main(port: int, kind: str) -> None:
    os.nice(_LOW_PRIORITY)
    target = Target(port)
    attack = asyncio.ensure_future(ATTACKS[kind](target))
    begun = asyncio.ensure_future(target.begun.wait())
    await asyncio.wait([attack, begun], return_when=asyncio.FIRST_COMPLETED)
    print("begun", flush=True)
    ended = asyncio.ensure_future(asyncio.to_thread(sys.stdin.read))
    await asyncio.wait([attack, ended], return_when=asyncio.FIRST_COMPLETED)
    attack.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await attack
    with contextlib.suppress(BrokenPipeError):  # the measuring process was interrupted
        print(json.dumps({"sent": target.sent, "sent_bytes": target.sent_bytes, "refused": target.refused}), flush=True)


if __name__ == "__main__":
    asyncio.run(_main(int(sys.argv[1]), sys.argv[2]))
