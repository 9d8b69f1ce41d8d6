"""The resources server: `seed_session` opens an episode, each tool is an endpoint, `verify` requests the reward.

A row of a dataset names its episode in `verifier_metadata`: `{"scene": 7, "seed": 3}`, or
`{"split": "train", "index": 0}` for an index in a split. `dataset.py` writes such rows.
"""

import asyncio
from typing import Any

import httpx
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import PlainTextResponse
from nemo_gym.base_resources_server import (
    BaseResourcesServerConfig,
    BaseSeedSessionRequest,
    BaseSeedSessionResponse,
    BaseVerifyRequest,
    BaseVerifyResponse,
    SimpleResourcesServer,
)
from nemo_gym.server_utils import SESSION_ID_KEY
from physment_laboratory import CONNECT_S, READ_S, LaboratoryError, request_of, result_of
from physment_referee import OpenedEpisode, Referee, RefereeError
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

_SESSIONS = 1000
"""Largest number of open sessions; a referee opens no more episodes by default."""


class PhysmentVariant(BaseModel):
    """The variant of a row."""

    scene: int | None = None
    seed: int | None = None
    world: dict[str, Any] | None = None
    split: str | None = None
    index: int | None = None
    random_seed: int | None = None
    budget: int = Field(20, ge=1, le=1000)
    """Iterations that the prompt of the row states; `max_steps` of the agent must be the same."""


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


class PhysmentResourcesServer(SimpleResourcesServer):
    """Sessions of NeMo Gym as episodes of the laboratory. A call is one POST, over a pool of connections."""

    config: BaseResourcesServerConfig
    _referee: Referee = PrivateAttr(default_factory=Referee.from_environment)
    _episodes: dict[str, OpenedEpisode] = PrivateAttr(default_factory=dict)
    """Session → its open episode."""
    _http: httpx.AsyncClient = PrivateAttr(
        default_factory=lambda: httpx.AsyncClient(
            timeout=httpx.Timeout(CONNECT_S, read=READ_S, pool=None), limits=httpx.Limits(max_connections=None)
        )
    )

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
        self._episodes.pop(request.session[SESSION_ID_KEY], None)
        while len(self._episodes) >= _SESSIONS:
            self._episodes.pop(next(iter(self._episodes)))  # the oldest: its agent never asked for its reward
        self._episodes[request.session[SESSION_ID_KEY]] = opened
        return BaseSeedSessionResponse()

    async def call(self, tool: str, request: Request) -> PlainTextResponse:
        """Call a tool of the session's episode; returns the text of the result or of the refusal."""
        opened = self._episodes.get(request.session[SESSION_ID_KEY])
        if opened is None:
            raise HTTPException(409, "no episode is open in this session: POST /seed_session first")
        arguments: Any = await request.json()
        if not isinstance(arguments, dict):
            return PlainTextResponse("the arguments must be a JSON object")
        headers, body = request_of(opened.player_token, tool, arguments)
        try:
            reply = await self._http.post(opened.mcp_url, content=body, headers=headers)
            return PlainTextResponse(result_of(reply.status_code, reply.content).text)
        except httpx.HTTPError as error:
            raise HTTPException(502, f"the host at {opened.mcp_url} cannot be reached ({error!r})") from error
        except LaboratoryError as error:
            raise HTTPException(502, str(error)) from error

    async def verify(self, request: Request, body: PhysmentVerifyRequest) -> PhysmentVerifyResponse:
        """Request the reward from the referee. An episode without an answer ends as budget exhausted."""
        opened = self._episodes.get(request.session[SESSION_ID_KEY])
        if opened is None:
            raise HTTPException(409, "no episode is open in this session, or its reward was given already")
        iterations = sum(item.type == "function_call" for item in body.response.output)
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
        self._episodes.pop(request.session[SESSION_ID_KEY], None)
        return PhysmentVerifyResponse(
            **body.model_dump(),
            reward=found.reward,
            outcome=found.outcome,
            strict=float(found.strict == "correct"),
            graded=found.graded,
            calls=found.calls,
        )


if __name__ == "__main__":
    PhysmentResourcesServer.run_webserver()
