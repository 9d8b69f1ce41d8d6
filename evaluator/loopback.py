"""Pages for people on this machine alone: which names mean it, and a guard for the applications that serve them."""

import re
from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine that only its own programs reach."""

_PLACE = re.compile(r"(?:\[(?P<ip6>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::[0-9]{1,5})?", re.ASCII | re.IGNORECASE)
"""A name or an address, with or without a port: all that a Host header may contain (RFC 9110, 7.2)."""


def is_for_this_machine(headers: Headers) -> bool:
    """Whether a request names this machine: one Host header with a name of `LOOPBACK`, and nothing more in it.

    Parsers of URLs are lenient, and each in its own way: they find 127.0.0.1 in `evil.example@127.0.0.1`.
    """
    hosts = headers.getlist("host")
    found = _PLACE.fullmatch(hosts[0]) if len(hosts) == 1 else None
    return found is not None and (found["ip6"] or found["name"]).lower() in LOOPBACK


class OnlyHere:
    """Refuses requests that name another host, and adds headers to every response.

    A web page can let its own name resolve to our address; its requests then name that host.

    Args:
        app: What is guarded.
        headers: Added to each response, lower case.
    """

    def __init__(self, app: ASGIApp, headers: Mapping[bytes, bytes] | None = None) -> None:
        self._app = app
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
        await (self._app if is_for_this_machine(Headers(scope=scope)) else refusal)(scope, receive, guarded)
