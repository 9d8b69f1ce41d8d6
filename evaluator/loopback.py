"""Middleware for web pages that only programs on this machine may request. It checks the Host and Origin headers."""

from collections.abc import Collection, Mapping

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.contract.addresses import LOOPBACK, named_host


def is_for_this_machine(headers: Headers, also: Collection[str] = ()) -> bool:
    """Whether a request has exactly one Host header, and it holds a name in `LOOPBACK` with or without a port.

    Args:
        headers: Headers of the request.
        also: Further names that are accepted: those of a proxy on this machine.
    """
    hosts = headers.getlist("host")
    return len(hosts) == 1 and named_host(hosts[0]) in {*LOOPBACK, *also}


def _is_own(headers: Headers, also: Collection[str]) -> bool:
    """Whether a request comes from a page of an accepted host, or from no page."""
    return all(named_host(one.partition("://")[2]) in {*LOOPBACK, *also} for one in headers.getlist("origin"))


class OnlyHere:
    """ASGI middleware that refuses requests to other hosts and adds headers to every response.

    It prevents DNS rebinding: a web page whose host name resolves to the loopback address sends that name as Host. It
    also refuses requests that pages of other hosts send (Origin).

    Args:
        app: The ASGI application to protect.
        headers: Headers to add to each response, with names in lower case.
        also: Host names of proxies on this machine, which are accepted, too.
    """

    def __init__(self, app: ASGIApp, headers: Mapping[bytes, bytes] | None = None, also: Collection[str] = ()) -> None:
        self._app, self._also = app, also
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
        accepted = is_for_this_machine(found, self._also) and _is_own(found, self._also)
        await (self._app if accepted else refusal)(scope, receive, guarded)
