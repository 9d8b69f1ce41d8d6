"""Protection of web pages that only this machine may request: a check of the Host header, and an ASGI middleware."""

from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.contract.addresses import LOOPBACK, named_host


def is_for_this_machine(headers: Headers) -> bool:
    """Whether a request has exactly one Host header, and it holds a name in `LOOPBACK` with or without a port."""
    hosts = headers.getlist("host")
    return len(hosts) == 1 and named_host(hosts[0]) in LOOPBACK


class OnlyHere:
    """ASGI middleware that refuses requests to other hosts and adds headers to every response.

    It prevents DNS rebinding: a web page whose host name resolves to the loopback address sends that name as Host.

    Args:
        app: The ASGI application to protect.
        headers: Headers to add to each response, with names in lower case.
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
