"""Sends malformed JSON-RPC frames to a live server and checks that they have no effect.

At regular intervals, valid calls must return the same as at the start. No reply and no line of the log may reveal
internals of the program. Handles frames and connections; does not use the laboratory's tools.
"""

import asyncio
import contextlib
import json
import random
import re
import sys
from asyncio.subprocess import PIPE
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Any

from tests.harness.load.hosting import hosted
from tests.harness.load.wire import Connection, call, opened, posted, request

_EVERY = 20
"""Number of frames between two valid calls."""
_PATIENCE_S = 60.0
"""Wall time without output after which a server counts as failed [s]."""
_INTERNALS = re.compile(
    rb"Traceback|File \\?\"|site-packages|\.py\b|0x[0-9a-f]{8}|pydantic|starlette|anyio|Exception\b"
)
_HELLO = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "frames", "version": "1"}}
_READS = ("get_position", "get_velocity", "get_parameters")
_METHODS: dict[str, Any] = {
    "ping": {},
    "tools/list": {},
    "prompts/list": {"cursor": "x"},
    "prompts/get": {"name": "scene"},
    "resources/read": {"uri": "physment://episode"},
    "resources/templates/list": {},
    "completion/complete": {
        "ref": {"type": "ref/prompt", "name": "scene"},
        "argument": {"name": "prompting", "value": ""},
    },
    "server/discover": {},
    "notifications/initialized": {},
    "notifications/cancelled": {"requestId": 1},
    "notifications/progress": {"progressToken": 1, "progress": 1},
}
_NO_METHODS = (
    "",
    "tools/Call",
    "tools/call ",
    "rpc.discover",
    "__init__",
    "../call",
    "x" * 5000,
    "tools/call\x00",
    "é",
)
_IDS = (None, True, -1, 0, 1.5, 2**63, -(2**70), 10**300, "", "x" * 5000, "\ud800", [], [1], {}, {"id": 1})
_VALUES = (None, True, 0, -1, 2**70, "", "\ud800", "\u2028", [], [[]], {}, {"": {}}, "x" * 5000)
_NUMBERS = (
    b"NaN",
    b"Infinity",
    b"-Infinity",
    b"1e400",
    b"-1e400",
    b"9" * 400,
    b"9" * 5000,
    b"-0",
    b"01",
    b"0x10",
    b".5",
)
_BYTES = (b"\xff", b"\xc3", b"\xed\xa0\x80", b"\x00", b"\xf5\x80\x80\x80", b"\xfe\xff")


def draw_frame(source: random.Random) -> bytes:
    """Generate a frame that cannot change the laboratory: it is malformed JSON, or at most requests a reading."""
    if source.random() < 0.4:
        change = {"name": source.choice(("step", "apply_force", "answer")), "arguments": {"duration": 1, "answer": 1}}
        return source.choice(_BREAKING)(_text(_message(source, "tools/call", change)), source)
    return source.choice(_BENDING)(source)


def _message(source: random.Random, method: Any = None, params: Any = None) -> dict[str, Any]:
    if method is None:
        method = source.choice((*_METHODS, "tools/call", "tools/call"))
        read = {"name": source.choice(_READS), "arguments": {"object_id": "object_1"}}
        params = read if method == "tools/call" else _METHODS[method]
    named = {} if method.startswith("notifications/") else {"id": source.randrange(10**6)}
    return {"jsonrpc": "2.0", **named, "method": method, "params": params}


def _text(message: Any) -> bytes:
    return json.dumps(message, allow_nan=True).encode()


def _cut(frame: bytes, source: random.Random) -> bytes:
    return frame[: source.randrange(1, len(frame))]


def _spliced(frame: bytes, source: random.Random) -> bytes:
    place = source.randrange(1, len(frame))
    return frame[:place] + source.choice((*_BYTES, b"\n", b"}", b"'", b"//")) + frame[place:] + b"]"


def _not_json(_frame: bytes, source: random.Random) -> bytes:
    choice = (
        b"",
        b" ",
        b"{",
        b"}",
        b"[" * 900,
        b'{"a":' * 900,
        b"null",
        b"true",
        b'"step"',
        b"7",
        b"NaN",
        b"\xef\xbb\xbf{}",
    )
    return source.choice((*choice, source.randbytes(200).replace(b"\n", b"\r")))


def _unclosed_number(frame: bytes, source: random.Random) -> bytes:
    return frame.replace(b'"duration": 1', b'"duration": ' + source.choice(_NUMBERS)).replace(b"}", b"", 1)


_BREAKING = (_cut, _spliced, _not_json, _unclosed_number)
"""Functions that make a frame that is not JSON, or not a message."""


def _wrong_id(source: random.Random) -> bytes:
    return _text(_message(source) | {"id": source.choice(_IDS)})


def _wrong_method(source: random.Random) -> bytes:
    return _text(_message(source) | {"method": source.choice((*_NO_METHODS, *_VALUES))})


def _wrong_params(source: random.Random) -> bytes:
    return _text(_message(source) | {"params": source.choice(_VALUES)})


def _wrong_field(source: random.Random) -> bytes:
    message = _message(source)
    params = message["params"]
    message["params"] = params | {source.choice([*params, "_meta", "x"]): source.choice(_VALUES)}
    return _text(message)


def _wrong_version(source: random.Random) -> bytes:
    message = _message(source)
    if source.random() < 0.3:
        del message["jsonrpc"]
        return _text(message)
    return _text(message | {"jsonrpc": source.choice(("1.0", 2.0, None, "", *_VALUES))})


def _wrong_number(source: random.Random) -> bytes:
    read = {"name": "get_position", "arguments": {"object_id": "object_1", "x": "@"}}
    return _text(_message(source, "tools/call", read)).replace(b'"@"', source.choice(_NUMBERS))


def _doubled(source: random.Random) -> bytes:
    message, other = _text(_message(source)), _text(_message(source))
    return message[:-1] + b", " + other[1:]


def _batch(source: random.Random) -> bytes:
    several = [_message(source) for _ in range(source.choice((0, 1, 2, 50)))]
    return _text([*several, 1] if source.random() < 0.3 else several)


def _response(source: random.Random) -> bytes:
    result = source.choice(({"result": {}}, {"error": {"code": 1, "message": "x"}}, {"result": 1, "error": 1}))
    return _text({"jsonrpc": "2.0", "id": source.choice((1, "1", *_IDS)), **result})


_BENDING = (
    *(_wrong_id, _wrong_method, _wrong_params, _wrong_field, _wrong_version, _wrong_number),
    *(_doubled, _batch, _response),
)
"""Functions that derive a frame from a valid one."""

Honest = Callable[[], Awaitable[Any]]
"""Makes one or several valid calls; returns their results."""
Send = Callable[[bytes], Awaitable[bytes]]
"""Sends a frame; returns the server's output up to the next valid call."""


async def play(count: int, source: random.Random, send: Send, honest: Honest) -> list[str]:
    """Send frames. Returns a sentence for each broken invariant, and stops at the third."""
    problems: list[str] = []
    usual, lately = await asyncio.wait_for(honest(), _PATIENCE_S), list[bytes]()
    for number in range(count):
        frame = draw_frame(source)
        lately.append(frame)
        try:
            said = await asyncio.wait_for(send(frame), _PATIENCE_S)
            if found := _INTERNALS.search(said):
                problems.append(f"{found[0]!r} in the reply {said[:600]!r} to {frame[:300]!r}")
            if (number + 1) % _EVERY == 0 or number == count - 1:
                now = await asyncio.wait_for(honest(), _PATIENCE_S)
                if now != usual:
                    problems.append(f"an honest call says {now}, not {usual}, after one of {[f[:300] for f in lately]}")
                lately.clear()
        except (TimeoutError, OSError, asyncio.IncompleteReadError, ValueError) as error:
            problems.append(f"{type(error).__name__} {error} after one of {[f[:300] for f in lately]}")
            break
        if len(problems) >= 3:
            break
    return problems


async def over_http(count: int, seed: int) -> list[str]:
    """Send frames to an episode of a host, some of them with the headers of the stateless protocol."""
    source = random.Random(f"http:{seed}")
    with hosted() as host:
        path = (await opened(host.port))["path"]

        async def asked(content: bytes) -> bytes:
            # The host may close a connection after a bad request, so each frame gets its own.
            connection = await Connection.dial(host.port)
            try:
                reply = await connection.ask(content)
            finally:
                connection.close()
            if reply.status >= 500:
                raise ValueError(f"status {reply.status}: {reply.body[:300]!r}")
            return reply.body

        async def send(frame: bytes) -> bytes:
            if source.random() < 0.5:
                return await asked(posted(path, frame, "tools/call", source.choice((None, "get_position", "step"))))
            headers = {"Accept": "application/json, text/event-stream", "Content-Type": "application/json"}
            return await asked(request("POST", path, frame, headers))

        async def honest() -> Any:
            replies = [await asked(call(path, tool, object_id="object_1")) for tool in _READS]
            return [json.loads(reply)["result"]["structuredContent"] for reply in replies]

        problems = await play(count, source, send, honest)
        return problems + host.errors()


@contextlib.asynccontextmanager
async def _on_stdio() -> AsyncGenerator[asyncio.subprocess.Process]:
    command = [sys.executable, "-m", "physment_mcp", "--scene", "7"]
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=PIPE, limit=2**24)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def over_stdio(count: int, seed: int) -> list[str]:
    """Send frames to an episode on stdio; the last one is an unfinished line."""
    source = random.Random(f"stdio:{seed}")
    async with _on_stdio() as process:
        stdin, stdout, stderr = process.stdin, process.stdout, process.stderr
        assert stdin is not None
        assert stdout is not None
        assert stderr is not None
        log, pending, ids = asyncio.ensure_future(stderr.read()), bytearray(), 10**9

        async def exchange(method: str, params: Any) -> Any:
            nonlocal ids
            ids += 1
            stdin.write(_text({"jsonrpc": "2.0", "id": ids, "method": method, "params": params}) + b"\n")
            await stdin.drain()
            while line := await stdout.readline():
                pending.extend(line)
                if json.loads(line).get("id") == ids:
                    return json.loads(line)["result"]
            raise ValueError("the server has ended")

        async def send(frame: bytes) -> bytes:
            # A line end inside a frame makes two frames, both broken.
            stdin.write(frame + source.choice((b"\n", b"\r\n", b"\n\n")))
            await stdin.drain()
            said = bytes(pending)
            pending.clear()
            return said

        async def honest() -> Any:
            arguments = {"object_id": "object_1"}
            results = [await exchange("tools/call", {"name": tool, "arguments": arguments}) for tool in _READS]
            return [result["structuredContent"] for result in results]

        await exchange("initialize", _HELLO)
        stdin.write(_text({"jsonrpc": "2.0", "method": "notifications/initialized"}) + b"\n")
        problems = await play(count, source, send, honest)
        stdin.write(b'{"jsonrpc": "2.0", "id": 1, "meth')
        stdin.close()
        code, logged = await asyncio.wait_for(process.wait(), _PATIENCE_S), await log
        if code != 0:
            problems.append(f"exit code {code} after half a line")
        if found := _INTERNALS.search(bytes(pending)) or _INTERNALS.search(logged):
            problems.append(f"{found[0]!r} in the replies, or in the log: {logged[-1500:]!r}")
        return problems
