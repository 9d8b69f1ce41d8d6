"""The page of a watched run over HTTP, on this machine only: three files, and the state as JSON.

Every address begins with a token, so that neither another user of the machine nor a web page can read the run.
"""

import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any

import anyio
import anyio.to_thread
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from evaluator.errors import StoreError
from evaluator.loopback import OnlyHere
from evaluator.watch.followed_run import FollowedRun
from evaluator.watch.state import state_of

_FRESH_S = 0.5
"""Two looks at the folder are this far apart at least [s], however many pages are open."""
_HEADERS = {
    b"cache-control": b"no-store",
    b"content-security-policy": b"default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self';"
    b" img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
}


def app(run: FollowedRun, token: str) -> Starlette:
    """The ASGI application that shows a run.

    Args:
        run: Which.
        token: First part of every path.
    """
    looks = _Looks(run)
    page = files("evaluator.watch") / "page"
    style = (files("evaluator.report") / "templates" / "style.css").read_bytes()
    return Starlette(
        routes=[
            Route(f"/{token}/", _file((page / "watch.html").read_bytes(), "text/html; charset=utf-8")),
            Route(f"/{token}/watch.js", _file((page / "watch.js").read_bytes(), "text/javascript; charset=utf-8")),
            Route(f"/{token}/watch.css", _file(style + (page / "watch.css").read_bytes(), "text/css; charset=utf-8")),
            Route(f"/{token}/state.json", looks.state),
            Route("/{path:path}", _unknown),
        ],
        middleware=[Middleware(OnlyHere, headers=_HEADERS)],
    )


@dataclass(slots=True)
class _Looks:
    """Looks at the folder when a page asks, in a thread: keys of some scenes take a second."""

    run: FollowedRun
    lock: anyio.Lock = field(default_factory=anyio.Lock)
    looked_at: float = -_FRESH_S
    last: dict[str, Any] = field(default_factory=dict[str, Any])

    async def state(self, _request: Request) -> Response:
        """The state of the run, or one sentence if its folder cannot be read any more."""
        async with self.lock:
            if self.run.behind or time.monotonic() - self.looked_at >= _FRESH_S:
                try:
                    self.last = await anyio.to_thread.run_sync(self._look)
                except StoreError as error:
                    return JSONResponse({"error": str(error)}, status_code=503)
                self.looked_at = time.monotonic()
            return JSONResponse(self.last)

    def _look(self) -> dict[str, Any]:
        self.run.look()
        return state_of(self.run, datetime.now(UTC))


def _file(content: bytes, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    async def answer(_request: Request) -> Response:
        return Response(content, media_type=media_type)

    return answer


async def _unknown(_request: Request) -> Response:
    return PlainTextResponse(
        "nothing is here: open the whole address that `physment-eval watch` printed, with its token\n", status_code=404
    )
