"""The warm host: many episodes in one process, each an MCP endpoint of its own over HTTP.

`POST /episodes {"scene": 7, "seed": 0}` opens one and returns its URL; whoever has the URL has the episode, whether
the client keeps a session, is stateless, or reconnects for each call. Seeds appear in no URL and no reply.

With `"max_calls": N` the host keeps a log of the calls, for an episode that somebody else is to play. The reply then
holds an `owner_token`; only with it can the log be read (`GET /episodes/ID/calls`) or the episode be closed, so whoever
was given the URL alone can do neither.
"""

import contextlib
import json
import logging
import secrets
import socket
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import anyio
from anyio.abc import TaskGroup, TaskStatus
from mcp.server.streamable_http_manager import RequestBodyLimitMiddleware, StreamableHTTPSessionManager
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from physment_mcp.call_log import CallLog
from physment_mcp.errors import SceneError
from physment_mcp.scene import load_scene
from physment_mcp.server import Laboratory, build_server
from physment_mcp.session import Session

logger = logging.getLogger(__name__)

MAX_BODY = 1_000_000
"""Largest accepted request body [bytes]."""
_SWEEP_S = 5.0
"""Wall time between looks for expired episodes [s], at most."""
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class EpisodeRequest(BaseModel):
    """Body of `POST /episodes`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scene: int
    seed: int = 0
    max_calls: int | None = Field(default=None, ge=1, le=10_000)
    """Most tool calls, of which the host then keeps a log; None for no limit and no log."""


@dataclass(slots=True)
class _Open:
    """An open episode."""

    manager: StreamableHTTPSessionManager
    laboratory: Laboratory
    close: Callable[[], None]
    last_used: float
    in_flight: int = 0
    owner_token: str | None = None
    """What closes the episode and opens its log; None if the URL is enough to close it and there is no log."""

    def owned_by(self, request: Request) -> bool:
        """Tell whether a request comes from who opened the episode."""
        return self.owner_token is None or _shows(request, self.owner_token)


@dataclass(slots=True)
class Host:
    """The episodes of one process."""

    scenes_dir: Path | None = None
    max_episodes: int = 1000
    idle_timeout_s: float = 1800.0
    token: str | None = field(default=None, repr=False)
    """What opens episodes; None if anybody may. Whoever has the URL of an episode needs none to play it."""
    _episodes: dict[str, _Open] = field(default_factory=dict[str, _Open])
    _opening: int = 0
    """Episodes on their way to being open; they count for the cap."""
    _tasks: TaskGroup | None = None

    def app(self) -> Starlette:
        """The ASGI application; answers only requests addressed to this machine."""
        routes = [
            Route("/healthz", self._health),
            Route("/episodes", self._create, methods=["POST"]),
            Route("/episodes/{episode_id}", self._delete, methods=["DELETE"]),
            Route("/episodes/{episode_id}/calls", self._calls, methods=["GET"]),
            Route("/episodes/{episode_id}/mcp", _Endpoint(self.serve)),
        ]
        return Starlette(
            routes=routes,
            lifespan=self._lifespan,
            middleware=[
                Middleware(TrustedHostMiddleware, allowed_hosts=[*LOOPBACK, "::1"], www_redirect=False),
                Middleware(RequestBodyLimitMiddleware, max_body_size=MAX_BODY),
            ],
        )

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        async with anyio.create_task_group() as tasks:
            self._tasks = tasks
            tasks.start_soon(self._sweep)
            yield
            tasks.cancel_scope.cancel()

    async def open_episode(self, scene: int, seed: int, max_calls: int | None = None) -> str:
        """Open an episode and return its unguessable id.

        Args:
            scene: Which scene.
            seed: Which variant of it.
            max_calls: Most tool calls, of which a log is kept; None for no limit and no log.

        Raises:
            SceneError: The scene cannot be loaded.
        """
        assert self._tasks is not None
        session = Session(load_scene(scene, seed, self.scenes_dir), max_calls=max_calls)
        laboratory = Laboratory(session, log=None if max_calls is None else CallLog())
        manager = StreamableHTTPSessionManager(build_server(laboratory), json_response=False, session_idle_timeout=None)
        episode_id = secrets.token_urlsafe(18)

        async def live(*, task_status: TaskStatus[Callable[[], None]]) -> None:
            with anyio.CancelScope() as scope:
                async with manager.run():
                    task_status.started(scope.cancel)
                    await anyio.sleep_forever()

        close = await self._tasks.start(live)
        owner_token = None if max_calls is None else secrets.token_urlsafe(24)
        self._episodes[episode_id] = _Open(manager, laboratory, close, time.monotonic(), owner_token=owner_token)
        return episode_id

    async def serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request to the MCP server of its episode."""
        episode = self._episodes.get(scope["path_params"]["episode_id"])
        if episode is None:
            await _refuse(404, "no such episode, or it has expired; open one with POST /episodes")(scope, receive, send)
            return
        episode.in_flight += 1
        try:
            await episode.manager.handle_request(scope, receive, send)
        finally:
            episode.in_flight -= 1
            episode.last_used = time.monotonic()

    async def _health(self, _request: Request) -> Response:
        return JSONResponse({"status": "ok", "episodes": len(self._episodes)})

    async def _create(self, request: Request) -> Response:
        if self.token is not None and not _shows(request, self.token):
            return _refuse(401, "episodes are opened with the token of this host: send it as a bearer token")
        try:
            wanted = EpisodeRequest.model_validate_json(await request.body() or b"{}")
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "body"
            return _refuse(400, f'{where}: {first["msg"]}; send {{"scene": 7, "seed": 0}}')
        if len(self._episodes) + self._opening >= self.max_episodes:
            return _refuse(429, f"{self.max_episodes} episodes are open, which is the limit; delete some or wait")
        self._opening += 1
        try:
            episode_id = await self.open_episode(wanted.scene, wanted.seed, wanted.max_calls)
        except SceneError as error:
            return _refuse(404, str(error))
        finally:
            self._opening -= 1
        expires = datetime.now(UTC) + timedelta(seconds=self.idle_timeout_s)
        url = f"{request.url.scheme}://{request.url.netloc}/episodes/{episode_id}/mcp"
        body = {"episode_id": episode_id, "mcp_url": url, "expires_at": expires.isoformat(timespec="seconds")}
        owner_token = self._episodes[episode_id].owner_token
        if owner_token is not None:
            body["owner_token"] = owner_token
        return JSONResponse(body, status_code=201)

    async def _delete(self, request: Request) -> Response:
        episode_id = request.path_params["episode_id"]
        episode = self._episodes.get(episode_id)
        if episode is None:
            return _refuse(404, "no such episode, or it has expired")
        if not episode.owned_by(request):
            return _refuse(401, "only who opened this episode can close it: send its owner_token as a bearer token")
        del self._episodes[episode_id]
        episode.close()
        return Response(status_code=204)

    async def _calls(self, request: Request) -> Response:
        episode = self._episodes.get(request.path_params["episode_id"])
        if episode is None:
            return _refuse(404, "no such episode, or it has expired")
        if not episode.owned_by(request):
            return _refuse(401, "only who opened this episode can read its log: send its owner_token as a bearer token")
        laboratory = episode.laboratory
        if laboratory.log is None:
            return _refuse(404, "no log is kept of this episode; open one with max_calls")
        start = request.query_params.get("start", "0")
        if not (start.isdecimal() and len(start) < 10):
            return _refuse(400, "start must be a whole number: the first call to tell, counted from 0")
        episode.last_used = time.monotonic()
        # A call that is running belongs to the log, so wait for its end.
        async with laboratory.lock:
            calls = [one.as_json() for one in laboratory.log.calls[int(start) :]]
            return JSONResponse({"ended": laboratory.open_session().ended, "calls": calls})

    async def _sweep(self) -> None:
        while True:
            await anyio.sleep(min(_SWEEP_S, self.idle_timeout_s / 2))
            oldest = time.monotonic() - self.idle_timeout_s
            for episode_id, episode in list(self._episodes.items()):
                if not episode.in_flight and episode.last_used < oldest:
                    del self._episodes[episode_id]
                    episode.close()
                    logger.info("an episode expired after %g s without a call", self.idle_timeout_s)


class _Endpoint:
    """An ASGI application as a class, which is how Starlette routes all methods of a path to it."""

    def __init__(self, serve: Callable[[Scope, Receive, Send], Awaitable[None]]) -> None:
        self._serve = serve

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._serve(scope, receive, send)


def _shows(request: Request, token: str) -> bool:
    """Tell whether a request bears a token."""
    shown = request.headers.get("authorization", "").removeprefix("Bearer ")
    return secrets.compare_digest(shown.encode(), token.encode())


def _refuse(status: int, sentence: str) -> JSONResponse:
    return JSONResponse({"error": sentence}, status_code=status)


def serve(host: Host, address: str, port: int) -> None:
    """Serve until interrupted; the address, also when the system chose the port, is printed as one JSON line.

    Raises:
        OSError: The address cannot be listened on.
    """
    import uvicorn  # noqa: PLC0415 - half a second that stdio episodes need not wait for

    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.create_server((address.strip("[]"), port), family=family, backlog=1024)
    # Inherited by every connection: held-back small packets would cost 40 ms a call.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    bound, chosen = listener.getsockname()[:2]
    shown = f"[{bound}]" if ":" in bound else bound
    print(json.dumps({"listening": f"http://{shown}:{chosen}"}), flush=True)  # noqa: T201 - the command's output
    config = uvicorn.Config(host.app(), log_level="warning", timeout_graceful_shutdown=2)
    uvicorn.Server(config).run(sockets=[listener])
