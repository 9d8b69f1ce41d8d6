"""The HTTP application that shows a running evaluation, on this machine only: page, JSON state, notebooks, report.

Every path begins with a secret token, which keeps out other users of the machine and other web pages.
"""

import functools
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any

import anyio.to_thread
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from evaluator.errors import EvaluatorError, StoreError
from evaluator.records.episode import EpisodeKey
from evaluator.report.agent_results import Run
from evaluator.report.page import render
from evaluator.scores.scoring import grade_record, score_episode
from evaluator.store.run_folder import RunFolder
from evaluator.watch.followed_run import FollowedRun
from evaluator.watch.state import state_of
from physment_mcp.contract.request_origin import OnlyHere

_FRESH_S = 0.5
"""Shortest time between two reads of the folder, regardless of the number of open pages [s]."""
_HEADERS = {
    b"cache-control": b"no-store",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
}
_POLICY = {
    "content-security-policy": "default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self';"
    " img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
}
"""Content security policy of the page. Reports and notebooks state their own, with the hash of their script."""


def app(folder: RunFolder, follow: Callable[[], FollowedRun | None], token: str) -> Starlette:
    """Build the ASGI application that shows a run.

    Args:
        folder: The folder of the run, which need not exist yet.
        follow: Function that opens the run; it returns None as long as the run does not exist.
        token: First segment of every path.
    """
    looks = _Looks(folder, follow)
    page = files("evaluator.watch") / "page"
    style = (files("evaluator.report") / "templates" / "style.css").read_bytes()
    return Starlette(
        routes=[
            Route(f"/{token}/", _file((page / "watch.html").read_bytes(), "text/html; charset=utf-8")),
            Route(f"/{token}/watch.js", _file((page / "watch.js").read_bytes(), "text/javascript; charset=utf-8")),
            Route(f"/{token}/watch.css", _file(style + (page / "watch.css").read_bytes(), "text/css; charset=utf-8")),
            Route(f"/{token}/state.json", looks.state),
            Route(f"/{token}/notebook", looks.notebook),
            Mount(f"/{token}/run", StaticFiles(directory=folder.path, check_dir=False)),
            Route("/{path:path}", _unknown),
        ],
        middleware=[Middleware(OnlyHere, headers=_HEADERS)],
    )


@dataclass(slots=True)
class _Looks:
    """Reads the run folder when a page requests the state.

    Reading runs in a thread, because some answer keys take a second.
    """

    folder: RunFolder
    follow: Callable[[], FollowedRun | None]
    run: FollowedRun | None = None
    lock: anyio.Lock = field(default_factory=anyio.Lock)
    looked_at: float = -_FRESH_S
    last: dict[str, Any] = field(default_factory=dict[str, Any])

    async def state(self, _request: Request) -> Response:
        """Return the state of the run, or an error message if its folder can no longer be read."""
        async with self.lock:
            if (self.run and self.run.behind) or time.monotonic() - self.looked_at >= _FRESH_S:
                try:
                    self.last = await anyio.to_thread.run_sync(self._look)
                except EvaluatorError as error:
                    return JSONResponse({"error": str(error)}, status_code=503)
                self.looked_at = time.monotonic()
            return JSONResponse(self.last)

    async def notebook(self, request: Request) -> Response:
        """Return the notebook of an ended episode. The query contains the key of the episode as JSON."""
        try:
            key = EpisodeKey.model_validate_json(request.query_params.get("key", ""))
            page = await anyio.to_thread.run_sync(functools.partial(self._notebook, key))
        except (ValidationError, EvaluatorError) as error:
            return PlainTextResponse(f"there is no notebook: {error}\n", status_code=404)
        return HTMLResponse(page)

    def _look(self) -> dict[str, Any]:
        self.run = self.run or self.follow()
        if self.run is None:
            return {"name": self.folder.path.resolve().name, "phase": "absent"}
        self.run.look()
        return state_of(self.run, datetime.now(UTC))

    def _notebook(self, key: EpisodeKey) -> str:
        """Render a report of one episode.

        Raises:
            StoreError: The episode has no record, or the seeds of the run are held back.
            UsageError: Its pack is missing here.
        """
        run = self.run
        episode = None if run is None or run.withheld else self.folder.episodes().get(key)
        if run is None or episode is None:
            raise StoreError("this episode has no record that can be graded here")
        row = score_episode(episode, grade_record(episode, run.keys), run.keys)
        return render([Run(self.folder.path.resolve().name, run.record, [row], {})], baselines=False).page


def _file(content: bytes, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    async def answer(_request: Request) -> Response:
        return Response(content, media_type=media_type, headers=_POLICY)

    return answer


async def _unknown(_request: Request) -> Response:
    return PlainTextResponse(
        "nothing is here: open the whole address that `physment-eval watch` printed, with its token\n", status_code=404
    )
