"""An episode that another program plays: opens it on a server, polls its state, and reads the server's call log."""

import contextlib
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import Any

import anyio
import httpx2
from mcp import Client
from pydantic import BaseModel, JsonValue, ValidationError

from evaluator.episode.hosts import HostConnector, http_client, mcp_client
from evaluator.episode.loop import opening_prompt
from evaluator.episode.player import ANSWER, Briefing, unrecordable
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import InfrastructureError
from evaluator.records.episode import EpisodeKey, Exchange, Outcome, ToolCall, Turn

_LOOK_S = 0.5
"""Wall time between two checks of whether the episode has ended [s]."""
_NO_CALLS = 999_999_999
"""A log position beyond the end of every log: a request from here returns only the state of the episode."""


class _SeenCall(BaseModel):
    """A call in the log of an episode server."""

    tool: str
    arguments: dict[str, Any]
    returned: bool
    is_error: bool
    content: dict[str, Any] | None
    text: str
    started_s: float
    duration_s: float


class _Log(BaseModel):
    """The call log of an episode, as the server publishes it."""

    ended: bool
    calls: list[_SeenCall]


@dataclass(frozen=True, slots=True)
class WatchedEpisode:
    """An open episode on a server that logs its calls."""

    mcp_url: str
    """Address of the episode, which its player receives."""
    token: str | None
    """Bearer token that the player must send with every request; None if no token is required."""
    _http: httpx2.AsyncClient
    _path: str
    _owner_token: str

    async def prompt(self, key: EpisodeKey) -> str:
        """Return the opening prompt without an iteration budget, because this episode is limited by calls.

        Raises:
            InfrastructureError: The server failed.
        """
        async with self._connected() as client:
            return await opening_prompt(client, key, None)

    async def briefing(self, key: EpisodeKey, toolboxes: Toolboxes) -> Briefing:
        """Return the briefing of an agent in the evaluator's loop: the prompt with its iteration budget, and the tools.

        Args:
            key: Key of the episode, with its prompting, protocol and budget.
            toolboxes: The tools of the server.

        Raises:
            InfrastructureError: The server failed.
        """
        async with self._connected() as client:
            toolbox = await toolboxes.of(client, key.scene)
            return Briefing(await opening_prompt(client, key, key.budget), toolbox.tools, key.budget, scene={})

    @contextlib.asynccontextmanager
    async def _connected(self) -> AsyncGenerator[Client]:
        try:
            async with mcp_client(self.mcp_url, self._http) as client:
                yield client
        except Exception as error:
            raise InfrastructureError(f"the opening prompt could not be read: {error!r}") from error

    async def until_end(self) -> bool:
        """Wait until the episode accepts no more calls.

        Returns:
            True once it is answered or its calls are used up; False if the server cannot be reached.
        """
        while True:
            try:
                if (await self._log(_NO_CALLS)).ended:
                    return True
            except InfrastructureError:
                return False
            await anyio.sleep(_LOOK_S)

    async def turns(self) -> tuple[Turn, ...]:
        """Return the calls so far, each as a turn.

        Raises:
            InfrastructureError: The server failed.
        """
        return _turns_of(await self._calls())

    async def _calls(self) -> list[_SeenCall]:
        """Return all calls so far, which the server sends in pages."""
        calls: list[_SeenCall] = []
        while page := (await self._log(len(calls))).calls:
            calls += page
        return calls

    async def _log(self, start: int) -> "_Log":
        headers = {"Authorization": f"Bearer {self._owner_token}"}
        try:
            reply = await self._http.get(f"{self._path}/calls", params={"start": start}, headers=headers)
            reply.raise_for_status()
            return _Log.model_validate_json(reply.content)
        except httpx2.HTTPStatusError as error:
            reason = f"{error.response.status_code} {error.response.text[:200]}"
            raise InfrastructureError(f"the log of calls could not be read: {reason}") from error
        except (httpx2.HTTPError, ValidationError) as error:
            raise InfrastructureError(f"the log of calls could not be read: {str(error)[:200]!r}") from error


@contextlib.asynccontextmanager
async def watch_episode(
    host: HostConnector, scene: int, seed: int, max_calls: int, *, guarded: bool = False
) -> AsyncGenerator[WatchedEpisode]:
    """Open an episode for another program, and close it afterwards.

    Args:
        host: Connector to the episode server.
        scene: Scene number.
        seed: Seed of the variant.
        max_calls: Largest number of tool calls; the server refuses more.
        guarded: Whether the player needs a token in addition to the address.

    Raises:
        InfrastructureError: The server cannot be reached, or keeps no call log.
    """
    async with http_client(host.base_url) as http:
        wanted = {"scene": scene, "seed": seed, "max_calls": max_calls} | ({"guarded": True} if guarded else {})
        opened = await host.request_episode(http, wanted)
        if "owner_token" not in opened:
            raise InfrastructureError(f"the host {host.base_url} keeps no logs of calls; it is too old for this")
        path, token = f"/episodes/{opened['episode_id']}", opened["owner_token"]
        try:
            player_token = opened.get("player_token")
            if player_token is not None:
                http.headers["Authorization"] = f"Bearer {player_token}"
            yield WatchedEpisode(opened["mcp_url"], player_token, http, path, token)
        finally:
            with anyio.CancelScope(shield=True), contextlib.suppress(httpx2.HTTPError):
                await http.delete(path, headers={"Authorization": f"Bearer {token}"})


def turns_of_log(content: bytes) -> tuple[Turn, ...]:
    """Convert a stored call log of a server to turns, one per call.

    Args:
        content: Response body of `GET /episodes/ID/calls`, or several such pages merged into one.

    Raises:
        ValidationError: The content is not a call log.
    """
    return _turns_of(_Log.model_validate_json(content).calls)


def _turns_of(calls: Sequence[_SeenCall]) -> tuple[Turn, ...]:
    turns: list[Turn] = []
    last_end_s = 0.0
    for call in calls:
        exchange = _exchange(call)
        agent_s = max(0.0, call.started_s - last_end_s)
        turns.append(Turn(reasoning="", exchanges=(exchange,), agent_s=agent_s, server_s=exchange.duration_s))
        last_end_s = call.started_s + call.duration_s
    return tuple(turns)


def outcome_of(turns: Sequence[Turn], max_calls: int) -> tuple[Outcome | None, JsonValue]:
    """Return the outcome and the answer of a logged episode.

    Args:
        turns: The logged calls, each as a turn.
        max_calls: Largest number of calls in the episode.

    Returns:
        The outcome, None if the episode may still continue; and the answer, None if there is none.
    """
    for turn in turns:
        for exchange in turn.exchanges:
            if exchange.call.tool == ANSWER and exchange.returned and not exchange.is_error:
                return Outcome.ANSWERED, exchange.call.arguments["answer"]
    return (Outcome.BUDGET_EXHAUSTED if len(turns) >= max_calls else None), None


def _exchange(seen: _SeenCall) -> Exchange:
    call = ToolCall(tool=seen.tool, arguments=seen.arguments)
    text, problem = seen.text, unrecordable(call)
    if problem:
        # Only refused calls are affected: a record can hold every answer that the server accepted.
        call, text = ToolCall(tool=seen.tool, arguments={}), f"{text} ({problem}, and is left out here)"
    return Exchange(
        call=call,
        returned=seen.returned,
        is_error=seen.is_error,
        content=seen.content,
        text=text,
        duration_s=seen.duration_s,
    )
