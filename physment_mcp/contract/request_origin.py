"""Checks of the headers Host and Origin, and middleware for pages that only this machine may request.

They prevent DNS rebinding. In this attack, a web page makes its own host name resolve to the address of a server on
this machine, and its requests to the server then carry that name.
"""

import re
from collections.abc import Collection, Mapping

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.contract.addresses import LOOPBACK

_PLACE = re.compile(r"(?:\[(?P<ip6>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::[0-9]{1,5})?", re.ASCII | re.IGNORECASE)
"""A name or an address, with or without a port: all that a Host header may contain (RFC 9110, 7.2)."""
_SCHEME = re.compile(r"[a-z][a-z0-9+.-]*://", re.ASCII | re.IGNORECASE)


def named_host(place: str) -> str | None:
    """Parse the host in a Host header or an origin: lower case, without port and brackets; None if it is malformed.

    URL parsers are too lenient for this check: they find 127.0.0.1 in `evil.example@127.0.0.1`.
    """
    found = _PLACE.fullmatch(place)
    return (found["ip6"] or found["name"]).lower() if found else None


def is_sent_to(names: Collection[str], headers: Headers) -> bool:
    """Whether a request has exactly one Host header, and it holds one of these names with or without a port."""
    hosts = headers.getlist("host")
    return len(hosts) == 1 and named_host(hosts[0]) in names


def foreign_origin(names: Collection[str], headers: Headers) -> str | None:
    """Return the first Origin header that names none of these hosts or is malformed; None if there is none."""
    for origin in headers.getlist("origin"):
        scheme = _SCHEME.match(origin)
        if scheme is None or named_host(origin[scheme.end() :]) not in names:
            return origin
    return None


class OnlyHere:
    """ASGI middleware that refuses requests whose Host or Origin is another host, and adds headers to every response.

    Args:
        app: The ASGI application to protect.
        headers: Headers to add to each response, with names in lower case.
        also: Host names of proxies on this machine, which are accepted, too.
    """

    def __init__(self, app: ASGIApp, headers: Mapping[bytes, bytes] | None = None, also: Collection[str] = ()) -> None:
        self._app, self._names = app, LOOPBACK | set(also)
        self._headers = tuple((headers or {}).items())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *self._headers]
            await send(message)

        refusal = JSONResponse({"error": "this page is for this machine alone"}, status_code=403)
        found = Headers(scope=scope)
        accepted = is_sent_to(self._names, found) and foreign_origin(self._names, found) is None
        await (self._app if accepted else refusal)(scope, receive, guarded)
