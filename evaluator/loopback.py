"""Pages for people on this machine alone: which names mean it, and a guard for the applications that serve them."""

from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.contract.addresses import LOOPBACK, named_host


def is_for_this_machine(headers: Headers) -> bool:
    """Whether a request names this machine: one Host header with a name of `LOOPBACK`, and nothing more in it."""
    hosts = headers.getlist("host")
    return len(hosts) == 1 and named_host(hosts[0]) in LOOPBACK


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
