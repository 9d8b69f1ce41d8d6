"""The resources server: `seed_session` opens an episode, each tool is an endpoint, `verify` requests the reward.

A row of a dataset names its episode in `verifier_metadata`: `{"scene": 7, "seed": 3}`, or
`{"split": "train", "index": 0}` for an index in a split. `dataset.py` writes such rows.
"""

import asyncio
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Any

import httpx
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import PlainTextResponse
from mcp import ClientSession, McpError
from mcp.client.streamable_http import streamable_http_client
from mcp.types import TextContent
from nemo_gym.base_resources_server import (
    BaseResourcesServerConfig,
    BaseSeedSessionRequest,
    BaseSeedSessionResponse,
    BaseVerifyRequest,
    BaseVerifyResponse,
    SimpleResourcesServer,
)
from nemo_gym.server_utils import SESSION_ID_KEY
from physment_referee import OpenedEpisode, Referee, RefereeError
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

_PATIENCE = httpx.Timeout(30.0, read=300.0)
"""[s]; a long `step` of a stiff scene takes minutes."""


_SESSIONS = 1000
"""Largest number of open sessions; a referee opens no more episodes by default."""


class PhysmentVariant(BaseModel):
    """The variant of a row."""

    scene: int | None = None
    seed: int | None = None
    split: str | None = None
    index: int | None = None
    random_seed: int | None = None
    budget: int = Field(20, ge=1, le=1000)
    """Iterations that the prompt of the row names; `max_steps` of the agent must be the same."""


class PhysmentSeedSessionRequest(BaseSeedSessionRequest):
    """A row of the dataset."""

    model_config = ConfigDict(extra="allow")

    verifier_metadata: PhysmentVariant


class PhysmentVerifyRequest(BaseVerifyRequest):
    """A row of the dataset with the agent's response."""

    model_config = ConfigDict(extra="allow")

    verifier_metadata: PhysmentVariant


class PhysmentVerifyResponse(BaseVerifyResponse):
    """The row with its reward."""

    model_config = ConfigDict(extra="allow")

    outcome: str
    strict: float
    graded: float
    calls: int


@dataclass(frozen=True, slots=True)
class _Player:
    """An open episode and the connection to it."""

    opened: OpenedEpisode
    session: ClientSession
    ended: asyncio.Event
    """Ends the connection."""


class PhysmentResourcesServer(SimpleResourcesServer):
    """Sessions of NeMo Gym as episodes of the laboratory."""

    config: BaseResourcesServerConfig
    _referee: Referee = PrivateAttr(default_factory=Referee.from_environment)
    _players: dict[str, _Player] = PrivateAttr(default_factory=dict)
    _connections: set[asyncio.Task[None]] = PrivateAttr(default_factory=set)

    def setup_webserver(self) -> FastAPI:
        """Return the application with the endpoints of NeMo Gym, and one for every tool."""
        app = super().setup_webserver()
        app.post("/{tool}")(self.call)
        return app

    async def seed_session(self, request: Request, body: PhysmentSeedSessionRequest) -> BaseSeedSessionResponse:
        """Open the episode of a row."""
        try:
            opened = await asyncio.to_thread(self._referee.open, **body.verifier_metadata.model_dump())
        except RefereeError as error:
            raise HTTPException(502, str(error)) from error
        self._leave(request.session[SESSION_ID_KEY])
        while len(self._players) >= _SESSIONS:
            self._leave(next(iter(self._players)))  # the oldest: its agent never asked for its reward
        self._players[request.session[SESSION_ID_KEY]] = await self._connect(opened)
        return BaseSeedSessionResponse()

    async def call(self, tool: str, request: Request) -> PlainTextResponse:
        """Call a tool of the session's episode; returns the text of the result or of the refusal."""
        player = self._players.get(request.session[SESSION_ID_KEY])
        if player is None:
            raise HTTPException(409, "no episode is open in this session: POST /seed_session first")
        arguments: Any = await request.json()
        if not isinstance(arguments, dict):
            return PlainTextResponse("the arguments must be a JSON object")
        try:
            result = await player.session.call_tool(tool, arguments)
        except McpError as error:
            return PlainTextResponse(str(error))
        return PlainTextResponse("\n".join(part.text for part in result.content if isinstance(part, TextContent)))

    async def verify(self, request: Request, body: PhysmentVerifyRequest) -> PhysmentVerifyResponse:
        """Request the reward from the referee. An episode without an answer ends as budget exhausted."""
        player = self._players.get(request.session[SESSION_ID_KEY])
        if player is None:
            raise HTTPException(409, "no episode is open in this session, or its reward was given already")
        iterations = sum(item.type == "function_call" for item in body.response.output)
        opened = player.opened
        player.ended.set()
        try:
            found = await asyncio.to_thread(
                self._referee.reward,
                opened.episode_id,
                opened.owner_token,
                iterations=iterations,
                end="budget_exhausted",
            )
        except RefereeError as error:
            raise HTTPException(502, str(error)) from error
        self._leave(request.session[SESSION_ID_KEY])
        return PhysmentVerifyResponse(
            **body.model_dump(),
            reward=found.reward,
            outcome=found.outcome,
            strict=float(found.strict == "correct"),
            graded=found.graded,
            calls=found.calls,
        )

    async def _connect(self, opened: OpenedEpisode) -> _Player:
        """Hold a connection to an episode. Opened and closed in one task, as its cancel scope requires."""
        ready: asyncio.Future[ClientSession] = asyncio.get_running_loop().create_future()
        ended = asyncio.Event()
        headers = {"Authorization": f"Bearer {opened.player_token}"}

        async def live() -> None:
            try:
                async with AsyncExitStack() as stack:
                    http = await stack.enter_async_context(httpx.AsyncClient(headers=headers, timeout=_PATIENCE))
                    read, write, _ = await stack.enter_async_context(
                        streamable_http_client(opened.mcp_url, http_client=http)
                    )
                    session = await stack.enter_async_context(ClientSession(read, write))
                    await session.initialize()
                    ready.set_result(session)
                    await ended.wait()
            except Exception as error:
                if ready.done():
                    raise
                ready.set_exception(HTTPException(502, f"the host cannot be reached: {error!r}"))

        task = asyncio.create_task(live())
        self._connections.add(task)
        task.add_done_callback(self._connections.discard)
        return _Player(opened, await ready, ended)

    def _leave(self, session_id: str) -> None:
        player = self._players.pop(session_id, None)
        if player is not None:
            player.ended.set()


if __name__ == "__main__":
    PhysmentResourcesServer.run_webserver()
