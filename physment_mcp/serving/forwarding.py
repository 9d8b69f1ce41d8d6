"""Requests that reach a worker of a host on a connection that belongs to it, for an episode of another worker.

The front of a host passes each connection to the worker of its first request. A client may go on with an episode of
another worker on it. Such a request is sent to the address of the host again, on a new connection.
"""

import re
from dataclasses import dataclass

import anyio
import httpx2
from starlette.types import ASGIApp, Receive, Scope, Send

from physment_mcp.serving.gate import refuse

EPISODE_OF = re.compile(r"/episodes/w(\d{1,4})\.")
"""A path, and the number of the worker whose episode it names."""
_FORWARDED = b"x-physment-forwarded"
"""Header of a request that has been forwarded, so that none goes round."""
_BETWEEN_TWO = {b"connection", b"keep-alive", b"transfer-encoding", b"upgrade", b"te", b"trailer"}
"""Headers that concern one connection only (RFC 9110, 7.6.1)."""


@dataclass(frozen=True, slots=True)
class HostWorker:
    """Which worker of a host this process is."""

    number: int
    """Counted from 0."""
    count: int
    """How many there are."""


class Forwarding:
    """Forwards requests for episodes of other workers. The body must come in one piece."""

    def __init__(self, app: ASGIApp, worker: HostWorker) -> None:
        """Set up.

        Args:
            app: Serves the requests for this worker.
            worker: Which one it is.
        """
        self._app = app
        self._worker = worker
        # A call may take long, and a stream for messages to come has no end. Our own host needs no proxy.
        self._client = httpx2.AsyncClient(
            timeout=None, trust_env=False, limits=httpx2.Limits(max_connections=None, max_keepalive_connections=20)
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request here or elsewhere."""
        found = EPISODE_OF.match(scope["path"]) if scope["type"] == "http" else None
        number = self._worker.number if found is None else int(found[1])
        if (
            number == self._worker.number
            or number >= self._worker.count
            or any(name == _FORWARDED for name, _ in scope["headers"])
        ):
            await self._app(scope, receive, send)
            return
        body = (await receive()).get("body", b"")
        async with anyio.create_task_group() as tasks:

            async def stop_with_client() -> None:
                while (await receive())["type"] != "http.disconnect":
                    pass
                tasks.cancel_scope.cancel()

            tasks.start_soon(stop_with_client)
            await self._forward(scope, body, receive, send)
            tasks.cancel_scope.cancel()

    async def _forward(self, scope: Scope, body: bytes, receive: Receive, send: Send) -> None:
        address, port = scope["server"]
        shown = f"[{address}]" if ":" in address else address
        query = scope["query_string"].decode("ascii", "replace")
        headers = [(name, value) for name, value in scope["headers"] if name not in _BETWEEN_TWO]
        request = self._client.build_request(
            scope["method"],
            f"http://{shown}:{port}{scope['path']}{f'?{query}' if query else ''}",
            headers=[*headers, (_FORWARDED, b"1")],
            content=body,
        )
        try:
            response = await self._client.send(request, stream=True)
        except httpx2.HTTPError:
            await refuse(502, "the worker of this episode cannot be reached; try again")(scope, receive, send)
            return
        try:
            kept = [(name.lower(), value) for name, value in response.headers.raw if name.lower() not in _BETWEEN_TWO]
            await send({"type": "http.response.start", "status": response.status_code, "headers": kept})
            async for part in response.aiter_raw():
                await send({"type": "http.response.body", "body": part, "more_body": True})
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        finally:
            with anyio.CancelScope(shield=True):
                await response.aclose()
