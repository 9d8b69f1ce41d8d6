"""The HTTP application of a person who plays in a browser. It accepts connections from this machine only.

Every path begins with a secret token, which keeps out other users of the machine and other web pages. Each browser page
identifies itself with a number, and only one page plays at a time: another one may take over, and the first is then
told. Every refusal is a JSON object with one sentence.
"""

import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import anyio
import anyio.lowlevel
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from evaluator.agents.browser.player import MOST_CALLS, MOST_NOTE, PageState
from evaluator.errors import RefusedRequest
from evaluator.loopback import OnlyHere
from evaluator.records.episode import ToolCall

MOST_BODY = 100_000
"""Largest accepted request body [bytes]."""
_POLL_S = 20.0
"""Longest wall time that a request for the state waits for a change [s]."""
ABSENT_S = 2 * _POLL_S
"""A page that has sent no request for this long counts as closed [s]."""
_PAGE_HEADER = "x-physment-page"
_HEADERS = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}
_ELSEWHERE = "this episode is open in another window"


class _Turn(BaseModel):
    """Body of `POST turn`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    calls: list[ToolCall] = Field(max_length=MOST_CALLS)
    note: str = Field(default="", max_length=MOST_NOTE)


def app(page: PageState, token: str) -> Starlette:
    """Build the ASGI application.

    Args:
        page: The state that the page shows; it also receives the person's turns.
        token: First segment of every path.
    """
    pages = _Pages(page)
    return Starlette(
        routes=[
            Route(f"/{token}/", _page),
            Route(f"/{token}/state", _answered(pages.state)),
            *(
                Route(f"/{token}/{name}", _answered(act), methods=["POST"])
                for name, act in (
                    ("turn", pages.turn),
                    ("leave", pages.leave),
                    ("close", pages.close),
                    ("next", pages.next),
                    ("take-over", pages.take_over),
                )
            ),
            Route(f"/{token}/report", _answered(pages.report)),
            Route("/{path:path}", _unknown),
        ],
        middleware=[Middleware(OnlyHere)],
    )


@dataclass(slots=True)
class _Pages:
    """Request handlers for the one page that is open."""

    page: PageState
    name: str = ""
    """Number of the open page; empty before the first request."""

    async def state(self, request: Request) -> Response:
        self._admit(request)
        after = request.query_params.get("after", "-1")
        known = int(after) if after.isdecimal() and len(after) < 10 else -1
        await self.page.newer_than(known, _POLL_S)
        self._admit(request)
        return JSONResponse(self.page.state())

    async def turn(self, request: Request) -> Response:
        self._admit(request)
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > MOST_BODY:
                raise RefusedRequest(413, f"an iteration has at most {MOST_BODY} bytes")
        try:
            wanted = _Turn.model_validate_json(body)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise RefusedRequest(400, f"no iteration: {'.'.join(map(str, first['loc']))} {first['msg']}") from None
        self.page.take(wanted.calls, wanted.note)
        return Response(status_code=204)

    async def leave(self, request: Request) -> Response:
        self._admit(request)
        self.page.leave()
        return Response(status_code=204)

    async def close(self, request: Request) -> Response:
        self._admit(request)
        self.page.close()
        return Response(status_code=204)

    async def next(self, request: Request) -> Response:
        self._admit(request)
        self.page.choose(request.query_params.get("play", ""))
        return Response(status_code=204)

    async def take_over(self, request: Request) -> Response:
        """Make this page the open one; the state of the other page is refused from now on."""
        self.name = ""
        self._admit(request)
        self.page.change()
        return Response(status_code=204)

    async def report(self, _request: Request) -> Response:
        """The report of the episode, once it is over. Links need no page number."""
        await anyio.lowlevel.checkpoint()
        ending = self.page.ending
        if ending is None or ending.report is None:
            raise RefusedRequest(404, "there is no report before the end of the episode")
        return FileResponse(ending.report, headers=_HEADERS)

    def _admit(self, request: Request) -> None:
        """Accept requests of the open page; a new page is accepted only if none is open.

        Raises:
            RefusedRequest: Another page is open, or the request does not say which page sent it.
        """
        name, now = request.headers.get(_PAGE_HEADER, ""), time.monotonic()
        is_open = self.name and now - self.page.seen_at < ABSENT_S
        if not name or (is_open and name != self.name):
            raise RefusedRequest(409, _ELSEWHERE)
        self.name, self.page.seen_at = name, now


def _answered(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    async def answered(request: Request) -> Response:
        try:
            return await answer(request)
        except RefusedRequest as refusal:
            return _refusal(refusal.status, str(refusal))

    return answered


def _refusal(status: int, sentence: str) -> Response:
    content: dict[str, Any] = {"error": sentence}
    return JSONResponse(content, status_code=status)


async def _page(_request: Request) -> Response:
    text = (files("evaluator.agents.browser") / "play.html").read_bytes()
    return Response(text, media_type="text/html; charset=utf-8", headers=_HEADERS)


async def _unknown(_request: Request) -> Response:
    await anyio.lowlevel.checkpoint()
    return _refusal(404, "nothing is here: open the whole address that `physment-eval play` printed, with its token")
