"""What a request must fulfil before the host serves it: names, origin, token, order, size, time, and JSON-RPC.

Knows HTTP, ASGI and the frame of JSON-RPC. Knows no episodes and no scenes.
"""

import logging
import re
import secrets
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, cast

import anyio
import mcp_types as types
from pydantic_core import from_json
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.contract.addresses import LOOPBACK, named_host
from physment_mcp.errors import quoted

logger = logging.getLogger(__name__)

MAX_BODY = 64_000
"""Largest accepted request [bytes], as a body or as a line: three times the largest call that a tool looks at."""
BODY_S = 15.0
"""Wall time from the headers of a request to the end of its body [s]."""

_SCHEME = re.compile(r"[a-z][a-z0-9+.-]*://", re.ASCII | re.IGNORECASE)
_ONE_OBJECT = 'a message is one JSON object, such as {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}'


class HttpGuard:
    """ASGI middleware that passes a request on with its whole body, or refuses it.

    It refuses requests that name another host or come from a web page of another site: a page in a browser on this
    machine can make its own host name resolve to our address (DNS rebinding), and its requests then name that host. The
    address that the connection was made to cannot be forged in this way, so it is accepted.

    Requests that reach no open episode enter one after another, so that many of them delay an episode little. Between
    two of them, the event loop serves whatever else is ready. The next does not wait for the end of the one before,
    because opening an episode takes long.

    Args:
        app: The application behind.
        reaches_episode: Whether a path belongs to an open episode.
        names: Names that it accepts besides its addresses and loopback.
        most: Largest accepted body [bytes].
        within_s: As `BODY_S`.
    """

    def __init__(
        self,
        app: ASGIApp,
        reaches_episode: Callable[[str], bool],
        names: Iterable[str] = (),
        most: int = MAX_BODY,
        within_s: float = BODY_S,
    ) -> None:
        self._app = app
        self._reaches_episode = reaches_episode
        self._names = LOOPBACK | {name.lower() for name in names}
        self._most = most
        self._within_s = within_s
        self._entrance = anyio.Semaphore(1)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it: 400 for a wrong Host, 403 for a wrong Origin, 413 or 408 for its body."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if not self._reaches_episode(scope["path"]):
            async with self._entrance:
                pass
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
        hosts, origins = request.headers.getlist("host"), request.headers.getlist("origin")
        if len(hosts) != 1 or named_host(hosts[0]) not in known:
            return refuse(400, f"this host does not go by the name {quoted(', '.join(hosts))}; --allow-host adds one")
        for origin in origins:
            scheme = _SCHEME.match(origin)
            if scheme is None or named_host(origin[scheme.end() :]) not in known:
                return refuse(403, f"pages of {quoted(origin)} may not speak to this host")
        return None

    async def _body(self, receive: Receive) -> bytes | JSONResponse | None:
        """The body of a request; a refusal of it; or None if the client broke the upload off."""
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
    """What an application receives of a request whose body was read: the body, then whatever the connection brings."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return first.pop() if first else await receive()

    return next_message


def has_token(request: Request, *tokens: str | None) -> bool:
    """Whether a request has one of these bearer tokens; None never matches."""
    scheme, _, shown = request.headers.get("authorization", "").partition(" ")
    given = shown.strip().encode()
    # Every token is compared, each in constant time, so the duration reveals nothing about them.
    matches = [secrets.compare_digest(given, token.encode()) for token in tokens if token]
    return scheme.lower() == "bearer" and any(matches)


def refuse(status: int, sentence: str) -> JSONResponse:
    """A response that refuses with a sentence; with status 401 it asks for a bearer token."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)


class Fault(NamedTuple):
    """What is wrong with a message."""

    code: int
    """Of JSON-RPC."""
    sentence: str

    def response(self) -> JSONResponse:
        """The answer to it."""
        error = {"code": self.code, "message": self.sentence}
        return JSONResponse({"jsonrpc": "2.0", "id": None, "error": error}, status_code=400)


def fault_of(body: bytes) -> Fault | None:
    """What is wrong with the body of a request; None if it is a JSON-RPC message.

    The MCP library would answer with the error of its validation: many lines that speak of its classes.
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
