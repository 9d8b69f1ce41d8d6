"""Plays one episode: an agent takes turns within a budget. Defines the participants of a run.

There are two kinds of participants. `AgentParticipant` plays an agent turn by turn in this loop.
`evaluator.agents.external` runs a program that plays by itself and is observed through the server's log.
"""

import base64
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import mcp_types as types
from mcp import Client, MCPError
from pydantic import JsonValue

from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.player import ANSWER, Agent, Briefing, Feedback, Player, Reply, as_text, bounded
from evaluator.episode.toolbox import Toolbox, Toolboxes
from evaluator.episode.tracing import call_span, end_call, note_call, note_turn, turn_span
from evaluator.errors import AgentError, InfrastructureError
from evaluator.records.episode import (
    UNREAD,
    Episode,
    EpisodeKey,
    Exchange,
    Frame,
    Outcome,
    ToolCall,
    Turn,
    Usage,
    Versions,
    timestamp,
    total_usage,
)
from physment_mcp.contract.names import GONE, SCENE_URI


@dataclass(frozen=True, slots=True)
class _Batch:
    """The calls of one turn and their results."""

    exchanges: tuple[Exchange, ...]
    note: str
    answered: bool


async def play_episode(
    agent: Agent,
    client: Client,
    key: EpisodeKey,
    versions: Versions,
    toolboxes: Toolboxes | None = None,
    used: list[Usage] | None = None,
) -> Episode:
    """Let an agent play one episode to its end.

    Args:
        agent: The agent that plays.
        client: A client connected to a fresh session of the scene.
        key: Key of the episode, with its iteration budget.
        versions: Versions of software and pack to record with the episode.
        toolboxes: Cached tools of the server; None to request them for this episode.
        used: List to which the usage of each reply is added, even if the episode fails. It may contain the usage of
            earlier attempts.

    Raises:
        InfrastructureError: The server failed; the episode has no outcome and may be played again.
    """
    started_at, clock = timestamp(), time.perf_counter()
    toolbox = await (toolboxes or Toolboxes()).of(client, key.scene)
    briefing = await _brief(client, key, toolbox)
    turns: list[Turn] = []
    used = [] if used is None else used
    outcome, answer, error = Outcome.BUDGET_EXHAUSTED, None, None
    try:
        player = agent.player(key, briefing)
        feedback: Feedback | None = None
        for remaining in range(key.budget - 1, -1, -1):
            note_turn(len(turns) + 1)
            with turn_span(len(turns) + 1):
                turn, answered = await _take_turn(player, feedback, client, toolbox, used)
            turns.append(turn)
            if answered:
                outcome, answer = Outcome.ANSWERED, _answer_of(turn.exchanges)
                break
            feedback = Feedback(turn.exchanges, turn.note, remaining)
    except AgentError as failure:
        outcome, error = Outcome.AGENT_ERROR, as_text(str(failure))
        if failure.usage is not None:
            used.append(failure.usage)
    return Episode(
        key=key,
        outcome=outcome,
        answer=answer,
        prompt=briefing.prompt,
        turns=tuple(turns),
        error=error,
        usage=total_usage(used),
        started_at=started_at,
        duration_s=time.perf_counter() - clock,
        versions=versions,
    )


async def _take_turn(
    player: Player, feedback: Feedback | None, client: Client, toolbox: Toolbox, used: list[Usage]
) -> tuple[Turn, bool]:
    """Play one iteration; return its turn, and whether an answer was accepted."""
    asked = time.perf_counter()
    reply = bounded(await player.act(feedback))
    replied = time.perf_counter()
    if reply.usage is not None:
        used.append(reply.usage)
    batch = await _run_batch(client, reply, toolbox)
    turn = Turn(
        reasoning=reply.reasoning,
        thought_chars=reply.thought_chars,
        exchanges=batch.exchanges,
        note=batch.note,
        usage=reply.usage,
        agent_s=replied - asked,
        server_s=time.perf_counter() - replied,
    )
    return turn, batch.answered


async def opening_prompt(client: Client, key: EpisodeKey, budget: int | None) -> str:
    """Request the opening prompt of an open episode.

    Args:
        client: A client connected to the episode.
        key: Key of the episode, with prompting and protocol.
        budget: Number of iterations that the prompt mentions; None to mention none.

    Raises:
        MCPError: The server refused the request.
    """
    arguments = {"prompting": key.prompting, "protocol": key.protocol}
    prompt = await client.get_prompt("scene", arguments if budget is None else {**arguments, "budget": str(budget)})
    parts = [message.content for message in prompt.messages]
    return "\n\n".join(part.text for part in parts if isinstance(part, types.TextContent))


async def _brief(client: Client, key: EpisodeKey, toolbox: Toolbox) -> Briefing:
    prompt = await opening_prompt(client, key, key.budget)
    return Briefing(prompt=prompt, tools=toolbox.tools, budget=key.budget, scene=await _scene_resource(client))


async def _scene_resource(client: Client) -> Mapping[str, Any]:
    try:
        contents = (await client.read_resource(SCENE_URI)).contents
    except MCPError:
        return {}
    return json.loads(contents[0].text) if isinstance(contents[0], types.TextResourceContents) else {}


async def _run_batch(client: Client, reply: Reply, toolbox: Toolbox) -> _Batch:
    """Run the calls of a turn in order, until one does not fit its schema or an answer is accepted.

    A call that the server refuses does not stop the following calls. The prompt states both rules, for each protocol.
    """
    if reply.malformed:
        return _Batch((), f"{UNREAD}: {reply.malformed}", answered=False)
    if not reply.calls:
        return _Batch((), "Your reply held no tool call.", answered=False)
    exchanges: list[Exchange] = []
    note, answered, stopped = "", False, False
    for call in reply.calls:
        if stopped:
            exchanges.append(Exchange(call=call, returned=False))
            continue
        misfit = toolbox.misfit(call)
        if misfit:
            note, stopped = f"{misfit}; this call and the ones after it were not run.", True
            exchanges.append(Exchange(call=call, returned=False, is_error=True, text=misfit))
            continue
        note_call(call.tool)
        with call_span(call.tool) as span:
            exchange = await _run(client, call, toolbox)
            end_call(span, exchange)
        exchanges.append(exchange)
        answered = stopped = call.tool == ANSWER and not exchange.is_error
    return _Batch(tuple(exchanges), note, answered)


async def _run(client: Client, call: ToolCall, toolbox: Toolbox) -> Exchange:
    clock = time.perf_counter()
    try:
        result = await toolbox.run(client, call)
    except Exception as error:
        raise InfrastructureError(f"{call.tool} did not return: {error!r}") from error
    if (result.meta or {}).get(GONE):
        raise InfrastructureError("the host closed the episode, or was started anew, before it ended")
    return Exchange(
        call=call,
        returned=True,
        is_error=result.is_error,
        content=None if result.is_error else result.structured_content,
        text="\n".join(part.text for part in result.content if isinstance(part, types.TextContent)),
        duration_s=time.perf_counter() - clock,
        frames=tuple(_frames(result)),
    )


def _frames(result: types.CallToolResult) -> Iterator[Frame]:
    """Yield the camera frames of a result.

    Raises:
        InfrastructureError: A frame cannot be decoded.
    """
    for part in result.content:
        if isinstance(part, types.ImageContent) and part.mime_type == "image/png":
            try:
                yield Frame.of(base64.b64decode(part.data, validate=True))
            except ValueError as error:
                raise InfrastructureError(f"a picture that the server sent is not base64: {error}") from error


def _answer_of(exchanges: Sequence[Exchange]) -> JsonValue:
    return next(
        exchange.call.arguments["answer"]
        for exchange in exchanges
        if exchange.returned and not exchange.is_error and exchange.call.tool == ANSWER
    )


class Participant(Protocol):
    """Plays the episodes of a run under one name: an agent in the loop, or an external program."""

    @property
    def name(self) -> str:
        """Name in records and tables, unique among the participants of the run."""
        ...

    def facts(self) -> Mapping[str, JsonValue]:
        """Settings besides the name that determine the results, for `run.json`. They contain no secrets."""
        ...

    def running(self) -> AbstractAsyncContextManager[object]:
        """Context that is open while the participant plays. Leaving it closes shared resources, such as connections."""
        ...

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Play one episode once.

        Args:
            laboratory: Connector that opens the episode.
            key: Key of the episode.
            versions: Versions of software and pack to record with the episode.
            used: List to which the usage of each reply of a model is added, even if the episode fails.

        Raises:
            InfrastructureError: A service failed; the episode has no outcome and may be played again.
            PermanentFailure: This participant cannot play any episode.
            UsageError: The participant cannot play in this laboratory.
        """
        ...


@dataclass(frozen=True, slots=True)
class AgentParticipant:
    """A participant whose agent the loop plays turn by turn."""

    agent: Agent
    decisive: Mapping[str, JsonValue] = field(default_factory=dict[str, JsonValue])
    """The value of `facts`."""
    owned: AbstractAsyncContextManager[object] = field(default_factory=nullcontext[None])
    """Context of the agent's resources, such as the HTTP client of a model."""

    @property
    def name(self) -> str:
        """The agent's name."""
        return self.agent.name

    def facts(self) -> Mapping[str, JsonValue]:
        """The settings that were given for the agent."""
        return self.decisive

    def running(self) -> AbstractAsyncContextManager[object]:
        """The context of the agent's resources."""
        return self.owned

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Play one episode, turn by turn."""
        async with laboratory.open(key.scene, key.seed) as client:
            return await play_episode(self.agent, client, key, versions, laboratory.toolboxes, used)

    def wrapped(self, wrap: Callable[[Agent], Agent]) -> "AgentParticipant":
        """Return a participant with the wrapped agent. `facts` and `running` are those of the unwrapped agent."""
        return replace(self, agent=wrap(self.agent))
