"""The HTTP application through which people play in a browser.

The application accepts requests only from this machine and from a proxy on it.

Every path begins with a secret token, which identifies one person. Each browser page identifies itself with a number,
and only one page of a person can play at a time. If another page takes over, requests of the first page are refused.
Every refusal is a JSON object with one sentence.
"""

import hashlib
import time
from collections.abc import Awaitable, Callable, Collection, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import anyio.lowlevel
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from evaluator.agents.browser.player import MOST_CALLS, MOST_NOTE, PageState
from evaluator.errors import RefusedRequest
from evaluator.records.episode import ToolCall
from physment_mcp.contract.request_origin import OnlyHere

MOST_BODY = 100_000
"""Largest accepted request body [bytes]."""
_POLL_S = 20.0
"""Longest wall time that a request for the state waits for a change [s]."""
ABSENT_S = 2 * _POLL_S
"""A page that has sent no request for this long counts as closed [s]."""
_PAGE_HEADER = "x-physment-page"
_HEADERS = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}
_LONGEST_NAME = 64
"""Largest number of characters in a page's number."""
_NOTHING = "nothing is here: open the whole address that you were given, with its token"
_ELSEWHERE = "this episode is open in another window"


class _Turn(BaseModel):
    """Body of `POST turn`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    calls: list[ToolCall] = Field(max_length=MOST_CALLS)
    note: str = Field(default="", max_length=MOST_NOTE)


def hash_of(token: str) -> str:
    """SHA-256 of a token. Looking up the hash takes the same time for every wrong token."""
    return hashlib.sha256(token.encode()).hexdigest()


def app(states: Mapping[str, PageState], also: Collection[str] = ()) -> Starlette:
    """Build the ASGI application.

    Args:
        states: SHA-256 of a token → state of the page; it also receives the person's turns.
        also: Accepted host names of proxies on this machine.
    """
    pages = _Pages(states)
    acts = (pages.agree, pages.turn, pages.leave, pages.close, pages.next, pages.take_over)
    return Starlette(
        routes=[
            Route("/{token}/", _answered(pages.page)),
            Route("/{token}/state", _answered(pages.state)),
            *(Route(f"/{{token}}/{act.__name__.replace('_', '-')}", _answered(act), methods=["POST"]) for act in acts),
            Route("/{token}/report", _answered(pages.report)),
            Route("/{path:path}", _unknown),
        ],
        middleware=[Middleware(OnlyHere, also=also)],
    )


@dataclass(frozen=True, slots=True)
class _Pages:
    """Request handlers."""

    states: Mapping[str, PageState]

    async def page(self, request: Request) -> Response:
        """Return the HTML of the page. A browser opens it without a page number."""
        await anyio.lowlevel.checkpoint()
        self._of(request)
        text = (files("evaluator.agents.browser") / "play.html").read_bytes()
        return Response(text, media_type="text/html; charset=utf-8", headers=_HEADERS)

    async def agree(self, request: Request) -> Response:
        self._admit(request).agree()
        return Response(status_code=204)

    async def state(self, request: Request) -> Response:
        page = self._admit(request)
        after = request.query_params.get("after", "-1")
        known = int(after) if after.isdecimal() and len(after) < 10 else -1
        await page.newer_than(known, _POLL_S)
        return JSONResponse(self._admit(request).state(), headers=_HEADERS)

    async def turn(self, request: Request) -> Response:
        page = self._admit(request)
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
        page.take(wanted.calls, wanted.note)
        return Response(status_code=204)

    async def leave(self, request: Request) -> Response:
        self._admit(request).leave()
        return Response(status_code=204)

    async def close(self, request: Request) -> Response:
        self._admit(request).close()
        return Response(status_code=204)

    async def next(self, request: Request) -> Response:
        self._admit(request).choose(request.query_params.get("play", ""))
        return Response(status_code=204)

    async def take_over(self, request: Request) -> Response:
        """Make this page the active one, so that requests of the person's other open pages are refused."""
        self._of(request).window = ""
        self._admit(request).change()
        return Response(status_code=204)

    async def report(self, request: Request) -> Response:
        """Return the report of an ended episode. A browser follows the link to it without a page number."""
        await anyio.lowlevel.checkpoint()
        ending = self._of(request).ending
        if ending is None or ending.report is None:
            raise RefusedRequest(404, "there is no report before the end of the episode")
        return FileResponse(ending.report, headers=_HEADERS)

    def _of(self, request: Request) -> PageState:
        """Return the state of the person whose token a request carries.

        Raises:
            RefusedRequest: Nobody has this token.
        """
        page = self.states.get(hash_of(request.path_params["token"]))
        if page is None:
            raise RefusedRequest(404, _NOTHING)
        return page

    def _admit(self, request: Request) -> PageState:
        """Accept requests of the open page; a new page is accepted only if none is open.

        Raises:
            RefusedRequest: Nobody has this token, another page is open, or the request does not say which page sent it.
        """
        page = self._of(request)
        name, now = request.headers.get(_PAGE_HEADER, "")[:_LONGEST_NAME], time.monotonic()
        is_open = page.window and now - page.seen_at < ABSENT_S
        if not name or (is_open and name != page.window):
            raise RefusedRequest(409, _ELSEWHERE)
        page.window, page.seen_at = name, now
        return page


def _answered(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    async def answered(request: Request) -> Response:
        try:
            return await answer(request)
        except RefusedRequest as refusal:
            return _refusal(refusal.status, str(refusal))

    return answered


def _refusal(status: int, sentence: str) -> Response:
    content: dict[str, Any] = {"error": sentence}
    return JSONResponse(content, status_code=status, headers=_HEADERS)


async def _unknown(_request: Request) -> Response:
    await anyio.lowlevel.checkpoint()
    return _refusal(404, _NOTHING)
