"""The reference agent, which plays the protocols of scene packs: generators of calls to the public tools."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError
from evaluator.records.episode import Episode, EpisodeKey, Exchange, ToolCall
from scenes import PackError, find_pack, reference_of
from scenes.protocol import ANSWER, Call, Exchanges, Protocol, Reading, load_solution
from scenes.reference_laws import stating


@dataclass(slots=True)
class ProtocolPlayer:
    """Plays a protocol, a generator of calls: each `yield` is one turn."""

    make: Callable[[str], Protocol]
    """Creates the protocol. Its docstring is recorded as the reasoning of the first turn."""
    prompt: str
    """The opening prompt."""
    protocol: Protocol = field(init=False)

    def __post_init__(self) -> None:
        self.protocol = self.make(self.prompt)

    async def act(self, feedback: Feedback | None) -> Reply:
        """Return the calls of the protocol's next `yield`.

        Raises:
            AgentError: The protocol raised an exception.
        """
        try:
            if feedback is None:
                calls = next(self.protocol)
            else:
                calls = self.protocol.send([reading_of(exchange) for exchange in feedback.exchanges])
        except StopIteration:
            return Reply(reasoning="The protocol has ended.")
        except Exception as error:
            raise AgentError(f"the protocol failed: {error!r}") from error
        return Reply(
            reasoning=(self.make.__doc__ or "").strip() if feedback is None else "",
            calls=tuple(ToolCall(tool=call.tool, arguments=call.arguments) for call in calls),
        )


def reading_of(exchange: Exchange) -> Reading:
    """Convert the result of a call for a protocol: its content, `{"error": sentence}`, or `{}` if it was not run."""
    if exchange.is_error:
        return {"error": exchange.text}
    return dict(exchange.content or {}) if exchange.returned else {}


def calls_and_readings(episode: Episode) -> Exchanges:
    """Return the calls of an episode, each with its reading, without the answer."""
    return [
        (Call(exchange.call.tool, dict(exchange.call.arguments)), reading_of(exchange))
        for turn in episode.turns
        for exchange in turn.exchanges
        if exchange.call.tool != ANSWER
    ]


@dataclass(frozen=True, slots=True)
class ReferenceAgent:
    """Plays the reference protocol of a scene: `solve` in its `solution.py`."""

    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    name: str = "reference"
    """Name in records and tables."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Start the reference protocol of the scene. Its answer contains a law if the scene asks for one.

        Raises:
            AgentError: The pack has no protocol.
        """
        try:
            files = find_pack(key.scene, self.scenes_dir)
            solve = load_solution(files).solve
        except PackError as error:
            raise AgentError(f"no reference protocol: {error}") from error
        if solve is None:
            raise AgentError(f"no reference protocol: solution.py of scene {reference_of(key.scene)} defines no solve")
        asks_for_law = any(
            tool.name == ANSWER and "law" in tool.input_schema.get("properties", {}) for tool in briefing.tools
        )
        return ProtocolPlayer(stating(files, solve) if asks_for_law else solve, briefing.prompt)
