"""The HTTP application of a referee.

`POST /episodes {"scene": 7, "seed": 3}` opens an episode, `POST /episodes/ID/reward` grades it, `DELETE /episodes/ID`
closes it, `POST /checks {"scene": 7, "seed": 3}` plays the reference protocol, `GET /variants?split=train` lists what a
split offers, `GET` and `DELETE /curricula/NAME` show and reset a curriculum, and `GET /metrics` is for Prometheus.
Every refusal is a JSON object with one sentence. This module handles HTTP and reads no answer keys.
"""

import contextlib
import secrets
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import asdict
from typing import Any, TypeVar

import anyio
from pydantic import BaseModel, ValidationError
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from evaluator.episode.player import Briefing
from evaluator.errors import InfrastructureError, RefusedRequest, StoreError, UsageError
from evaluator.referee.contract import EndedEpisode, Reward, WantedEpisode, WantedGroup, WantedVariants
from evaluator.referee.episodes import Referee
from evaluator.referee.recording import CONTENT_TYPE
from physment_mcp.contract.addresses import LOOPBACK
from physment_mcp.contract.request_origin import is_sent_to
from scenes import is_world, reference_of

M = TypeVar("M", bound=BaseModel)

_MAX_BODY = 16_000
"""Largest accepted request body [bytes]."""
_BODY_S = 15.0
"""Longest time for receiving a request body [s]."""
_MOST_QUOTED = 64
"""Largest number of characters that a refusal quotes from a request."""
RETRY_S = 5
"""Wall time after which a trainer should retry if all `max_episodes` are in use [s]."""
_SWEEP_S = 5.0
"""Longest wall time between two searches for expired episodes [s]."""


def app(referee: Referee, token: str | None = None) -> Starlette:
    """Build the ASGI application of a referee.

    Args:
        referee: The referee that handles the requests.
        token: Bearer token for opening and checking episodes; None if any program on this machine may do so.
    """
    answers = _Answers(referee, token)
    return Starlette(
        routes=[
            Route("/healthz", answers.health),
            Route("/metrics", answers.answered(answers.metrics)),
            Route("/variants", answers.answered(answers.variants)),
            Route("/curricula/{name}", answers.answered(answers.curriculum), methods=["GET", "DELETE"]),
            Route("/episodes", answers.answered(answers.open), methods=["POST"]),
            Route("/episodes/{episode_id}", answers.answered(answers.close), methods=["DELETE"]),
            Route("/episodes/{episode_id}/reward", answers.answered(answers.reward), methods=["POST"]),
            Route("/checks", answers.answered(answers.check), methods=["POST"]),
        ],
        middleware=[Middleware(_PageGate)] if token is None else [],
        lifespan=answers.lifespan,
    )


class _PageGate:
    """Middleware of a referee without a token: it refuses requests from web pages and from other machines."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            # DNS rebinding: a page can resolve its own host name to this address, but its requests carry that name.
            if not is_sent_to(LOOPBACK, headers) or "origin" in headers:
                await _refusal(403, "web pages and other machines may not speak to a referee without a token")(
                    scope, receive, send
                )
                return
        await self._app(scope, receive, send)


class _Answers:
    """Request handlers of a referee."""

    def __init__(self, referee: Referee, token: str | None) -> None:
        self._referee = referee
        self._token = token

    @contextlib.asynccontextmanager
    async def lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        """Close expired episodes while the application runs, and all episodes at its end."""
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(self._sweep)
            try:
                yield
            finally:
                tasks.cancel_scope.cancel()
                with anyio.CancelScope(shield=True):
                    await self._referee.close_all()

    async def _sweep(self) -> None:
        while True:
            await anyio.sleep(min(_SWEEP_S, self._referee.max_wall_s / 2))
            await self._referee.sweep()

    def answered(self, answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
        """Wrap a request handler: convert exceptions of the evaluator to responses with one sentence."""

        async def endpoint(request: Request) -> Response:
            try:
                return await answer(request)
            except RefusedRequest as refusal:
                return self._refused(refusal.status, str(refusal))
            except UsageError as error:
                return self._refused(404, str(error))
            except InfrastructureError as error:
                return self._refused(502, f"{error}; this says nothing about the agent: open another episode")
            except StoreError as error:
                return self._refused(507, f"{error}; ask again when it can be")

        return endpoint

    def _refused(self, status: int, sentence: str) -> Response:
        self._referee.metrics.refused[status] += 1
        return _refusal(status, sentence)

    async def health(self, _request: Request) -> Response:
        """Return the number of open episodes."""
        return JSONResponse({"status": "ok", "episodes": self._referee.open_episodes})

    async def open(self, request: Request) -> Response:
        """Open an episode."""
        self._check_token(request)
        wanted = await _body(request, WantedGroup, '{"scene": 7, "seed": 3}')
        opened = await self._referee.open(wanted, wanted.count or 1, wanted.curriculum)
        first = opened[0].variant
        found: dict[str, Any] = {
            "scene": first.scene,
            "world": reference_of(first.scene) if is_world(first.scene) else None,
            "split": first.split or None,
            "index": first.index,
            **_briefing(opened[0].briefing),
        }
        places = [
            {name: getattr(one, name) for name in ("episode_id", "owner_token", "mcp_url", "player_token")}
            for one in opened
        ]
        found |= places[0] if wanted.count is None else {"episodes": places}
        return JSONResponse(found, status_code=201)

    async def variants(self, request: Request) -> Response:
        """Return public properties of the scenes of a split or of worlds."""
        self._check_token(request)
        wanted = _valid(WantedVariants, dict(request.query_params), "?split=train")
        return JSONResponse(asdict(await self._referee.listed(wanted)))

    async def curriculum(self, request: Request) -> Response:
        """Return the state of a curriculum, or delete it."""
        self._check_token(request)
        curricula, name = self._referee.variants.curricula, request.path_params["name"]
        if request.method == "DELETE":
            curricula.reset(name)
            return Response(status_code=204)
        return JSONResponse(curricula.state(name))

    async def metrics(self, request: Request) -> Response:
        """Return the counters for Prometheus."""
        self._check_token(request)
        text = self._referee.metrics.text(self._referee.open_episodes, self._referee.max_episodes)
        return Response(text, media_type=CONTENT_TYPE)

    async def reward(self, request: Request) -> Response:
        """Grade an episode."""
        ended = await _body(request, EndedEpisode, '{"iterations": 7}')
        found = await self._referee.reward(request.path_params["episode_id"], _bearer(request), ended)
        return JSONResponse(_reward(found))

    async def close(self, request: Request) -> Response:
        """Close an episode without a reward."""
        await self._referee.close(request.path_params["episode_id"], _bearer(request))
        return Response(status_code=204)

    async def check(self, request: Request) -> Response:
        """Play the reference protocol of a scene."""
        self._check_token(request)
        wanted = await _body(request, WantedEpisode, '{"scene": 7, "seed": 3}')
        return JSONResponse(_reward(await self._referee.check(wanted)))

    def _check_token(self, request: Request) -> None:
        if self._token is not None and not secrets.compare_digest(_bearer(request).encode(), self._token.encode()):
            raise RefusedRequest(401, "send the token of this referee as a bearer token (Authorization: Bearer ...)")


def _briefing(briefing: Briefing) -> dict[str, Any]:
    tools = [
        {"name": tool.name, "description": tool.description, "input_schema": tool.input_schema}
        for tool in briefing.tools
    ]
    return {"prompt": briefing.prompt, "budget": briefing.budget, "tools": tools}


def _reward(found: Reward) -> dict[str, Any]:
    """Convert a reward to JSON. The reason of the grade is omitted, because it may state the answer key."""
    return {
        "reward": found.reward,
        "strict": found.grade.strict.value,
        "graded": found.grade.graded,
        "normalised": found.grade.normalised.value,
        "parts": found.answer.parts,
        "chance": found.answer.chance,
        "cost": found.cost,
        "outcome": found.outcome.value,
        "calls": found.calls,
        **({} if found.shaping is None else {"shaping": found.shaping}),
    }


def _bearer(request: Request) -> str:
    """Return the bearer token of a request; empty if it has none."""
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


async def _body(request: Request, kind: type[M], example: str) -> M:
    """Parse the body of a request; an empty body has all defaults.

    Raises:
        RefusedRequest: The body is too large, takes too long, or does not fit the model.
    """
    content = bytearray()
    with anyio.move_on_after(_BODY_S) as patience:
        async for part in request.stream():
            content += part
            if len(content) > _MAX_BODY:
                raise RefusedRequest(413, f"a request has at most {_MAX_BODY} bytes")
    if patience.cancelled_caught:
        raise RefusedRequest(408, f"the request took longer than {_BODY_S:g} s")
    return _valid(kind, bytes(content) or b"{}", example)


def _valid(kind: type[M], content: bytes | dict[str, str], example: str) -> M:
    """Validate a body or a query.

    Raises:
        RefusedRequest: It does not fit the model.
    """
    try:
        return kind.model_validate_json(content) if isinstance(content, bytes) else kind.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])[:_MOST_QUOTED] or "body"
        raise RefusedRequest(400, f"{where}: {first['msg']}; send {example}") from error


def _refusal(status: int, sentence: str) -> JSONResponse:
    headers = {401: {"WWW-Authenticate": "Bearer"}, 429: {"Retry-After": str(RETRY_S)}}.get(status)
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)
