"""Checks of connections and requests before the host serves them.

The protocol limits the number of connections and the time for headers. The middleware checks the Host and Origin
headers, and the size and time of bodies. Functions for the host check tokens and the form of JSON-RPC messages.
Independent of episodes. Attacks have the names that `tests.harness.load.hostile` uses.
"""

import asyncio
import contextlib
import logging
import secrets
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Sized
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import anyio
import mcp_types as types
from pydantic_core import from_json
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.auto import AutoHTTPProtocol
from uvicorn.protocols.http.flow_control import FlowControl

from physment_mcp.contract.addresses import LOOPBACK
from physment_mcp.contract.request_origin import foreign_origin, is_sent_to
from physment_mcp.errors import quoted

logger = logging.getLogger(__name__)

MAX_BODY = 64_000
"""Largest accepted request [bytes], as a body or as a line: three times the largest call that a tool accepts."""
BODY_S = 15.0
"""Deadline for the body of a request [s], from the end of its headers (attack `slow uploads`)."""

REQUEST_S = 15.0
"""Deadline for the headers of a request [s], from the opening of the connection or the first byte of the request."""
_READ = 2048
"""Size of one read from a connection [bytes]. uvicorn parses all requests in it at once (attack `slow readers`)."""
_WARN_S = 60.0
"""Shortest time between two warnings that connections are refused [s]."""
_ONE_OBJECT = 'a message is one JSON object, such as {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}'


@dataclass(slots=True)
class Connections:
    """Counts open connections, in total and per client address (attack `half-open connections`)."""

    most: int
    most_of_address: int
    _open: Counter[str] = field(default_factory=Counter[str])
    _warned_at: float = -_WARN_S

    def enter(self, address: str) -> bool:
        """Count a new connection; returns False, and does not count it, if there are too many."""
        if self._open.total() < self.most and self._open[address] < self.most_of_address:
            self._open[address] += 1
            return True
        if time.monotonic() - self._warned_at >= _WARN_S:
            self._warned_at = time.monotonic()
            logger.warning(
                "connections are turned away: %d are open, %d of them from %s (at most %d and %d)",
                *(self._open.total(), self._open[address], address, self.most, self.most_of_address),
            )
        return False

    def leave(self, address: str) -> None:
        """Record that a counted connection is closed."""
        self._open[address] -= 1
        if not self._open[address]:
            del self._open[address]


def bounded_protocol(connections: Connections, request_s: float = REQUEST_S) -> type[asyncio.Protocol]:
    """Return the protocol class of one server, for `uvicorn.Config`.

    Args:
        connections: Counter of the connections of this server.
        request_s: See `REQUEST_S`.
    """
    return type("HostProtocol", (_BoundedProtocol,), {"open_connections": connections, "request_s": request_s})


class _Reading(FlowControl):
    """Flow control that pauses reading while pipelined requests wait (attack `slow readers`).

    uvicorn resumes reading whenever the application awaits a part of a request. It would then parse and keep all
    pipelined requests of a connection, which may be thousands.
    """

    def __init__(self, transport: asyncio.Transport, waiting: Sized) -> None:
        super().__init__(transport)
        self._waiting = waiting

    def resume_reading(self) -> None:
        """Resume, unless requests wait."""
        if not self._waiting:
            super().resume_reading()


class _BoundedProtocol(AutoHTTPProtocol):
    """One connection, with a deadline for headers (attack `half-open connections`)."""

    open_connections: Connections
    request_s: float
    _address: str | None = None
    """Address of the client; None while the connection is not counted."""
    _deadline: asyncio.TimerHandle | None = None
    _transport: Any = None

    def connection_made(self, transport: Any) -> None:
        """Count the connection, or close it at once if there are too many."""
        peer = transport.get_extra_info("peername")
        address = str(peer[0]) if peer else ""
        self._transport = transport
        with contextlib.suppress(AttributeError):  # other event loops than asyncio's read as much as they like
            transport.max_size = _READ
        super().connection_made(transport)
        waiting = getattr(self, "pipeline", None)  # uvicorn's other parser, h11, stops by itself
        if waiting is not None:
            self.flow = _Reading(transport, waiting)
        if self.open_connections.enter(address):
            self._address = address
            self._wait()
        else:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Start the deadline at the first byte of a request; stop it when the headers are complete."""
        if self._deadline is None and not self._in_request():
            self._wait()
        super().data_received(data)
        if self._in_request() and self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the deadline, and count the connection as closed."""
        if self._deadline is not None:
            self._deadline.cancel()
        if self._address is not None:
            self.open_connections.leave(self._address)
            self._address = None
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._deadline = asyncio.get_running_loop().call_later(self.request_s, self._give_up)

    def _give_up(self) -> None:
        logger.info("a connection was closed: no complete request within %g s", self.request_s)
        self._transport.close()

    def _in_request(self) -> bool:
        """Return whether the headers of a request have been read, and its response is not complete."""
        cycle: Any = getattr(self, "cycle", None)
        return cycle is not None and not cycle.response_complete


class HttpGuard:
    """ASGI middleware that reads the body of a request and passes the request on, or refuses it.

    It refuses a Host header with a foreign name, and an Origin header of a foreign site (DNS rebinding). The local
    address of the connection cannot be forged in this way, so it is accepted. Starlette's `TrustedHostMiddleware`
    compares with a fixed list, which cannot hold the addresses of a server that listens on all interfaces.

    Args:
        app: The application behind the middleware.
        admit: Asynchronous function that is called with the path of each request before any check.
        names: Accepted names besides the server's addresses and loopback.
        most: Largest accepted body [bytes].
        within_s: See `BODY_S`.
    """

    def __init__(
        self,
        app: ASGIApp,
        admit: Callable[[str], Awaitable[None]],
        names: Iterable[str] = (),
        most: int = MAX_BODY,
        within_s: float = BODY_S,
    ) -> None:
        self._app = app
        self._admit = admit
        self._names = LOOPBACK | {name.lower() for name in names}
        self._most = most
        self._within_s = within_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it: 400 for its Host, 403 for its Origin, 413 or 408 for its body."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        await self._admit(scope["path"])
        # White space after a value does not belong to it (RFC 9110, 5.5), but httptools leaves it there.
        scope["headers"] = [(name, value.rstrip(b" \t")) for name, value in scope["headers"]]
        if refusal := self._wrong_place(Request(scope)):
            await refusal(scope, receive, send)
            return
        body = await self._body(receive)
        if isinstance(body, bytes):
            await self._app(scope, with_body(body, receive), send)
        elif body is not None:
            await body(scope, receive, send)

    def _wrong_place(self, request: Request) -> JSONResponse | None:
        address = (request.scope.get("server") or (None,))[0]
        known = self._names if address is None else self._names | {address.lower()}
        if not is_sent_to(known, request.headers):
            hosts = ", ".join(request.headers.getlist("host"))
            return refuse(400, f"this host does not go by the name {quoted(hosts)}; --allow-host adds one")
        origin = foreign_origin(known, request.headers)
        if origin is not None:
            return refuse(403, f"pages of {quoted(origin)} may not speak to this host")
        return None

    async def _body(self, receive: Receive) -> bytes | JSONResponse | None:
        """Return the body; a response that refuses it; or None if the client disconnected during the upload."""
        body = bytearray()
        complete = False
        with anyio.move_on_after(self._within_s):
            while not complete and len(body) <= self._most:
                message = await receive()
                if message["type"] == "http.disconnect":
                    logger.info("an upload was broken off after %d bytes", len(body))
                    return None
                body += message.get("body", b"")
                complete = not message.get("more_body", False)
        if len(body) > self._most:
            return refuse(413, f"a request has at most {self._most} bytes")
        return bytes(body) if complete else refuse(408, f"the request took longer than {self._within_s:g} s")


def with_body(body: bytes, receive: Receive) -> Receive:
    """Return an ASGI `receive` that yields a body that was read already, then the messages of the original one."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return first.pop() if first else await receive()

    return next_message


def has_token(request: Request, *tokens: str | None) -> bool:
    """Return whether a request carries one of these bearer tokens; None never matches."""
    scheme, _, shown = request.headers.get("authorization", "").partition(" ")
    given = shown.strip().encode()
    # Every token is compared, each in constant time, so the duration reveals nothing about them.
    matches = [secrets.compare_digest(given, token.encode()) for token in tokens if token]
    return scheme.lower() == "bearer" and any(matches)


def refuse(status: int, sentence: str) -> JSONResponse:
    """Return a response that refuses with a sentence; with status 401 it asks for a bearer token."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)


class Fault(NamedTuple):
    """A JSON-RPC error about a message."""

    code: int
    sentence: str

    def response(self) -> JSONResponse:
        """The error as an HTTP response."""
        error = {"code": self.code, "message": self.sentence}
        return JSONResponse({"jsonrpc": "2.0", "id": None, "error": error}, status_code=400)


def fault_of(body: bytes) -> Fault | None:
    """Return the error in the body of a request; None if it is a JSON-RPC message.

    The MCP SDK would reply with the text of a pydantic error, which names its classes.
    """
    try:
        message: Any = from_json(body)
    except ValueError as error:
        return Fault(types.PARSE_ERROR, f"this is not JSON: {error}")
    if not isinstance(message, dict):
        return Fault(types.INVALID_REQUEST, _ONE_OBJECT)
    fields = cast("dict[str, Any]", message)
    wrong = _wrong_request(fields) if "method" in fields else _wrong_response(fields)
    if fields.get("jsonrpc") != "2.0":
        wrong = '`jsonrpc` must be "2.0"'
    return Fault(types.INVALID_REQUEST, wrong) if wrong else None


def _wrong_request(fields: dict[str, Any]) -> str:
    if not isinstance(fields["method"], str):
        return "`method` must be a text, such as tools/list"
    if not isinstance(fields.get("params"), dict | None):
        return "`params` must be an object"
    return "" if "id" not in fields or _is_id(fields["id"]) else "`id` must be a whole number or a text"


def _wrong_response(fields: dict[str, Any]) -> str:
    error = fields.get("error")
    if isinstance(error, dict):
        named = cast("dict[str, Any]", error)
        well = isinstance(named.get("code"), int) and isinstance(named.get("message"), str)
    else:
        well = isinstance(fields.get("result"), dict)
    return "" if well and _is_id(fields.get("id")) else _ONE_OBJECT


def _is_id(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool))
