"""An episode that somebody else plays: opened on a host, watched, and read back from the host's own log of calls."""

import contextlib
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any

import anyio
import httpx2
import mcp_types as types
from pydantic import BaseModel, ValidationError

from evaluator.episode.connect import HostLaboratory, http_client, mcp_client
from evaluator.episode.loop import unrecordable
from evaluator.errors import InfrastructureError
from evaluator.records import EpisodeKey, Exchange, ToolCall, Turn

_LOOK_S = 0.5
"""Wall time between looks at whether the episode has ended [s]."""
_NO_CALLS = 999_999_999
"""A place in the log where there are none: asks for the state alone."""


class _SeenCall(BaseModel):
    """A call, as a host tells of it."""

    tool: str
    arguments: dict[str, Any]
    returned: bool
    is_error: bool
    content: dict[str, Any] | None
    text: str
    started_s: float
    duration_s: float


class _Log(BaseModel):
    """The log of an episode, as a host publishes it."""

    ended: bool
    calls: list[_SeenCall]


@dataclass(frozen=True, slots=True)
class WatchedEpisode:
    """An open episode whose calls its host keeps a log of."""

    mcp_url: str
    """All that its player is given."""
    _http: httpx2.AsyncClient
    _path: str
    _owner_token: str

    async def prompt(self, key: EpisodeKey) -> str:
        """The opening prompt without a word on the budget, which here is one of calls.

        Raises:
            InfrastructureError: The host failed.
        """
        arguments = {"prompting": key.prompting, "protocol": key.protocol}
        try:
            async with mcp_client(self.mcp_url, self._http) as client:
                said = await client.get_prompt("scene", arguments)
        except Exception as error:
            raise InfrastructureError(f"the opening prompt could not be read: {error!r}") from error
        return "\n\n".join(one.content.text for one in said.messages if isinstance(one.content, types.TextContent))

    async def until_end(self) -> bool:
        """Wait until nothing more can be called in the episode.

        Returns:
            True once it is answered or out of calls; False if the host is gone.
        """
        while True:
            try:
                if (await self._log(_NO_CALLS)).ended:
                    return True
            except InfrastructureError:
                return False
            await anyio.sleep(_LOOK_S)

    async def turns(self) -> tuple[Turn, ...]:
        """What was called so far, a turn for each call.

        Raises:
            InfrastructureError: The host failed.
        """
        turns: list[Turn] = []
        before = 0.0
        for one in (await self._log(0)).calls:
            exchange = _exchange(one)
            thought = max(0.0, one.started_s - before)
            turns.append(Turn(reasoning="", exchanges=(exchange,), agent_s=thought, server_s=exchange.duration_s))
            before = one.started_s + one.duration_s
        return tuple(turns)

    async def _log(self, start: int) -> "_Log":
        headers = {"Authorization": f"Bearer {self._owner_token}"}
        try:
            reply = await self._http.get(f"{self._path}/calls", params={"start": start}, headers=headers)
            reply.raise_for_status()
            return _Log.model_validate_json(reply.content)
        except httpx2.HTTPStatusError as error:
            said = f"{error.response.status_code} {error.response.text[:200]}"
            raise InfrastructureError(f"the log of calls could not be read: {said}") from error
        except (httpx2.HTTPError, ValidationError) as error:
            raise InfrastructureError(f"the log of calls could not be read: {str(error)[:200]!r}") from error


@contextlib.asynccontextmanager
async def watch_episode(host: HostLaboratory, scene: int, seed: int, max_calls: int) -> AsyncGenerator[WatchedEpisode]:
    """Open an episode for somebody else, and close it afterwards.

    Args:
        host: Where.
        scene: Which scene.
        seed: Which variant of it.
        max_calls: Most tool calls; the laboratory refuses those beyond.

    Raises:
        InfrastructureError: The host cannot be reached, or keeps no logs.
    """
    async with http_client(host.base_url) as http:
        opened = await host.request_episode(http, {"scene": scene, "seed": seed, "max_calls": max_calls})
        if "owner_token" not in opened:
            raise InfrastructureError(f"the host {host.base_url} keeps no logs of calls; it is too old for this")
        path, token = f"/episodes/{opened['episode_id']}", opened["owner_token"]
        try:
            yield WatchedEpisode(opened["mcp_url"], http, path, token)
        finally:
            with anyio.CancelScope(shield=True), contextlib.suppress(httpx2.HTTPError):
                await http.delete(path, headers={"Authorization": f"Bearer {token}"})


def _exchange(said: _SeenCall) -> Exchange:
    call = ToolCall(tool=said.tool, arguments=said.arguments)
    text, problem = said.text, unrecordable(call)
    if problem:
        # Only a refused call can be so; what an answer may hold, a record can hold.
        call, text = ToolCall(tool=said.tool, arguments={}), f"{text} ({problem}, and is left out here)"
    return Exchange(
        call=call,
        returned=said.returned,
        is_error=said.is_error,
        content=said.content,
        text=text,
        duration_s=said.duration_s,
    )
