"""The episode server: many episodes in one process, each with an MCP endpoint of its own over HTTP.

The command line, the replies and the documentation call it a host.

`POST /episodes {"scene": 7, "seed": 0}` opens an episode and returns its URL. The URL identifies the episode, whether
the client keeps a session, is stateless, or reconnects for each call. Seeds appear in no URL and in no reply.

If the server has a token, only requests that carry it open episodes. If other machines can reach the server, every
request needs the token, with one exception: episodes that were opened with `"max_calls": N`, because the program that
plays them knows only the URL. The reply to such a request contains an `owner_token`. Reading the log of calls
(`GET /episodes/ID/calls`) and closing the episode require this token or that of the server.
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
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from physment_mcp.errors import NotOpened
from physment_mcp.scene import Scene
from physment_mcp.serving.admission import Admission, EpisodeQuota
from physment_mcp.serving.http_guard import MAX_BODY, HttpGuard, fault_of, has_token, refuse, with_body
from physment_mcp.serving.scheduling import Scheduler
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.serving.socket_episodes import SocketEpisodes
from physment_mcp.serving.views import Frames
from physment_mcp.session import Session
from physment_mcp.visibility import Visibility, cached_visibility

logger = logging.getLogger(__name__)

_SESSIONS = 200
"""Largest number of open MCP sessions of an episode. Some clients open one for each call and close none.

A session takes about 40 kB and 120 objects of the garbage collector.
"""
_SWEEP_S = 5.0
"""Longest time between two removals of expired episodes [s]."""
_GONE = (
    "there is no such episode: it has expired, was closed, or never was; open one with"
    ' POST /episodes {"scene": 7, "seed": 0} on this host, and connect to the mcp_url it returns'
)
_AUTHORIZE = "send the token of this host as a bearer token (Authorization: Bearer ...)"


@dataclass(slots=True)
class _HostedEpisode:
    """An open episode and its endpoint."""

    manager: StreamableHTTPSessionManager
    slot: EpisodeSlot
    close: Callable[[], None]
    last_used: float
    in_flight: int = 0
    owner_token: str | None = None
    """Token that closes the episode and reads its log, if another program plays it."""
    player_token: str | None = None
    """Token that every request of the playing program needs; None if the URL suffices."""


@dataclass(slots=True)
class EpisodeServer:
    """Opens, serves and closes the episodes of one process."""

    scenes_dir: Path | None = None
    max_episodes: int = 1000
    idle_timeout_s: float = 1800.0
    token: str | None = field(default=None, repr=False)
    """Token that opens episodes; None if none is needed."""
    exposed: bool = False
    """Whether other machines can reach the server; then every request needs the token."""
    names: tuple[str, ...] = ()
    """Accepted names in Host headers, besides its addresses and those of loopback."""
    watch: Callable[[Session], Frames] | None = None
    """Creates the frames of an episode; None for results without frames."""
    timestep: float | None = None
    """Time step that replaces those of the models [s]."""
    id_prefix: str = ""
    """Prefix of the id of every episode, by which a proxy routes to this server."""
    control: socket.socket | None = None
    """Receives the sockets of episodes from the program that started this process; None if there is none."""
    opened_at_start: bytes | None = None
    """Request for an episode that is opened at the start with the id `0`; None for none."""
    _episodes: dict[str, _HostedEpisode] = field(default_factory=dict[str, _HostedEpisode])
    _admission: Admission = field(init=False)
    _sockets: SocketEpisodes = field(init=False)
    _tasks: TaskGroup | None = None
    _gone_manager: StreamableHTTPSessionManager | None = None
    """Serves requests for episodes that are gone: its replies say how to open another."""
    _gone_slot: EpisodeSlot = field(default_factory=lambda: EpisodeSlot(gone=_GONE))
    _scheduler: Scheduler = field(default_factory=Scheduler)
    _find_visibility: Callable[[Scene], Visibility] = field(init=False)
    """Returns the visibility of a scene."""

    def __post_init__(self) -> None:
        assert self.token or not self.exposed, "a host that other machines can reach needs a token"
        # Only the operator has the token, and may read details of packs.
        quota = EpisodeQuota(self.max_episodes)
        self._admission = Admission(self.scenes_dir, quota, self.timestep, bool(self.token))
        self._find_visibility = cached_visibility(self.scenes_dir)
        self._sockets = SocketEpisodes(self._admission, self.watch, self._find_visibility, self._scheduler)

    def app(self) -> Starlette:
        """The ASGI application."""
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
            middleware=[Middleware(HttpGuard, admit=self._admit, names=self.names)],
        )

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        async with anyio.create_task_group() as tasks:
            self._tasks = tasks
            tasks.start_soon(self._sweep)
            if self.control is not None:
                tasks.start_soon(self._sockets.serve, self.control)
            # Stateless: it can also reply to a client that has a session of the episode that is gone.
            gone = build_server(self._gone_slot)
            self._gone_manager, _ = await self._run(StreamableHTTPSessionManager(gone, stateless=True))
            if self.opened_at_start is not None:
                await self.open_episode(self.opened_at_start, "0")
            yield
            tasks.cancel_scope.cancel()

    async def _run(
        self, manager: StreamableHTTPSessionManager
    ) -> tuple[StreamableHTTPSessionManager, Callable[[], None]]:
        """Run a session manager of the MCP SDK in a task; returns it and a function that ends the task."""
        assert self._tasks is not None

        async def live(*, task_status: TaskStatus[Callable[[], None]]) -> None:
            with anyio.CancelScope() as scope:
                async with manager.run():
                    task_status.started(scope.cancel)
                    await anyio.sleep_forever()

        return manager, await self._tasks.start(live)

    async def open_episode(self, body: bytes, episode_id: str | None = None) -> str:
        """Open an episode and return its id.

        Args:
            body: The request, as `EpisodeRequest` in JSON.
            episode_id: Its id; None for one that cannot be guessed.

        Raises:
            NotOpened: The request is refused.
        """
        wanted, session = await self._admission.open(body)
        try:
            slot = EpisodeSlot(
                session, watch=self.watch, find_visibility=self._find_visibility, scheduler=self._scheduler
            )
            server = build_server(slot)
            manager = StreamableHTTPSessionManager(
                server, session_idle_timeout=None, max_sessions=_SESSIONS, max_request_body_size=MAX_BODY
            )
            manager, close = await self._run(manager)
        except BaseException:
            self._admission.quota.release()
            raise
        if episode_id is None:
            episode_id = f"{self.id_prefix}{secrets.token_urlsafe(18)}"
        self._episodes[episode_id] = _HostedEpisode(
            manager,
            slot,
            close,
            time.monotonic(),
            owner_token=None if wanted.max_calls is None else secrets.token_urlsafe(24),
            player_token=secrets.token_urlsafe(24) if wanted.guarded else None,
        )
        return episode_id

    async def serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the MCP server of its episode, or to the server that answers for closed episodes."""
        request = Request(scope, receive)
        episode = self._episodes.get(scope["path_params"]["episode_id"])
        if not self._may_play(request, episode):
            await refuse(401, _AUTHORIZE)(scope, receive, send)
            return
        if request.method == "POST":
            body = await request.body()
            if fault := fault_of(body):
                await fault.response()(scope, receive, send)
                return
            receive = with_body(body, receive)
        if episode is None:
            assert self._gone_manager is not None
            async with self._gone_slot.turns.turn():
                await self._gone_manager.handle_request(scope, receive, send)
        elif request.method == "GET":
            # A stream for messages of the server, which the client keeps open; it does not count as use of the episode.
            await episode.manager.handle_request(scope, receive, send)
        else:
            episode.in_flight += 1
            try:
                async with episode.slot.turns.turn():
                    await episode.manager.handle_request(scope, receive, send)
            finally:
                episode.in_flight -= 1
                episode.last_used = time.monotonic()

    def _may_play(self, request: Request, episode: _HostedEpisode | None) -> bool:
        """Return whether a request may reach the episode of its URL. A wrong token is always refused."""
        owner_token = None if episode is None else episode.owner_token
        if episode is not None and episode.player_token is not None:
            return has_token(request, self.token, owner_token, episode.player_token)
        if self.token is None or has_token(request, self.token, owner_token):
            return True
        return "authorization" not in request.headers and (not self.exposed or owner_token is not None)

    def _owns(self, request: Request, episode: _HostedEpisode) -> bool:
        """Return whether a request comes from the program that opened the episode."""
        if episode.owner_token is None and not self.exposed:
            return self._may_play(request, episode)  # only the program that opened it knows its URL
        return has_token(request, self.token, episode.owner_token)

    async def _admit(self, path: str) -> None:
        """Wait until the scheduler admits a request; requests for open episodes are admitted at once."""
        _, _, rest = path.partition("/episodes/")
        if rest.partition("/")[0] not in self._episodes:
            await self._scheduler.enter()

    async def _health(self, _request: Request) -> Response:
        return JSONResponse({"status": "ok", "episodes": self._admission.quota.taken})

    async def _create(self, request: Request) -> Response:
        if self.token is not None and not has_token(request, self.token):
            return refuse(401, f"episodes are opened with a token; {_AUTHORIZE}")
        try:
            episode_id = await self.open_episode(await request.body())
        except NotOpened as refusal:
            return refuse(refusal.status, str(refusal))
        expires = datetime.now(UTC) + timedelta(seconds=self.idle_timeout_s)
        url = f"{request.url.scheme}://{request.url.netloc}/episodes/{episode_id}/mcp"
        body = {"episode_id": episode_id, "mcp_url": url, "expires_at": expires.isoformat(timespec="seconds")}
        opened = self._episodes[episode_id]
        tokens = {"owner_token": opened.owner_token, "player_token": opened.player_token}
        body |= {name: token for name, token in tokens.items() if token is not None}
        return JSONResponse(body, status_code=201)

    async def _delete(self, request: Request) -> Response:
        episode_id = request.path_params["episode_id"]
        episode = self._episodes.get(episode_id)
        if episode is None:
            return refuse(404, "no such episode, or it has expired")
        if not self._owns(request, episode):
            return refuse(401, "only who opened this episode can close it: send its owner_token as a bearer token")
        self._close(episode_id)
        return Response(status_code=204)

    def _close(self, episode_id: str) -> None:
        episode = self._episodes.pop(episode_id)
        self._admission.quota.release()
        episode.close()
        episode.slot.close(_GONE)

    async def _calls(self, request: Request) -> Response:
        episode = self._episodes.get(request.path_params["episode_id"])
        if episode is None:
            return refuse(404, "no such episode, or it has expired")
        if not self._owns(request, episode):
            return refuse(401, "only who opened this episode can read its log: send its owner_token as a bearer token")
        # Local references, because the episode may be closed while this waits.
        session, log, turns = episode.slot.open_session(), episode.slot.log, episode.slot.turns
        if session.max_calls is None:
            return refuse(404, "no log is kept of this episode; open one with max_calls")
        start = request.query_params.get("start", "0")
        if not (start.isdecimal() and len(start) < 10):
            return refuse(400, "start must be a whole number: the index of the first call to return, counted from 0")
        episode.last_used = time.monotonic()
        # Wait for a running call, because it belongs to the log.
        async with turns.turn(), turns.exclusive:
            calls = ",".join(logged.as_json() for logged in log.page_from(int(start)))
            ended = json.dumps(session.ended)
            return Response(f'{{"ended":{ended},"calls":[{calls}]}}', media_type="application/json")

    async def _sweep(self) -> None:
        while True:
            await anyio.sleep(min(_SWEEP_S, self.idle_timeout_s / 2))
            oldest = time.monotonic() - self.idle_timeout_s
            expired = [
                episode_id
                for episode_id, episode in self._episodes.items()
                if not episode.in_flight and episode.last_used < oldest
            ]
            for episode_id in expired:
                self._close(episode_id)
            if count := len(expired) + self._sockets.expire(oldest):
                logger.info("%d episodes expired after %g s without a call", count, self.idle_timeout_s)


class _Endpoint:
    """An ASGI class, because Starlette limits the route of a plain function to GET."""

    def __init__(self, serve: Callable[[Scope, Receive, Send], Awaitable[None]]) -> None:
        self._serve = serve

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._serve(scope, receive, send)
