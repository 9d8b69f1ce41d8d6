"""Pages for people on this machine alone: which names mean it, and a guard for the applications that serve them."""

from collections.abc import Mapping
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine that only its own programs reach."""


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

        name = urlsplit(f"//{Request(scope).headers.get('host', '')}").hostname
        refusal = JSONResponse({"error": "this page is for this machine alone"}, status_code=403)
        await (self._app if name in LOOPBACK else refusal)(scope, receive, guarded)
