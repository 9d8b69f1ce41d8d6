"""The reference agent: plays the protocol of a pack through the public tools, which shows that it can be solved."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError
from evaluator.records import EpisodeKey, Exchange, ToolCall
from scenes import PackError, find_pack
from scenes.protocol import Call, Protocol, Reading, load_solution


@dataclass(frozen=True, slots=True)
class ReferenceAgent:
    """Plays the protocol in `solution.py` of the scene."""

    scenes_dir: Path | None = None
    name: str = "reference"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ReferencePlayer":
        """Start the protocol of the scene.

        Raises:
            AgentError: The pack has no protocol.
        """
        try:
            solve = load_solution(find_pack(key.scene, self.scenes_dir)).solve
        except PackError as error:
            raise AgentError(f"no reference protocol: {error}") from error
        if solve is None:
            raise AgentError(f"no reference protocol: solution.py of scene {key.scene} defines no solve")
        return _ReferencePlayer(solve(briefing.prompt), (solve.__doc__ or "").strip())


@dataclass(slots=True)
class _ReferencePlayer:
    protocol: Protocol
    doc: str

    async def act(self, feedback: Feedback | None) -> Reply:
        try:
            calls = next(self.protocol) if feedback is None else self.protocol.send(_readings(feedback.exchanges))
        except StopIteration:
            return Reply(reasoning="The protocol has ended.")
        except Exception as error:
            raise AgentError(f"the reference protocol failed: {error!r}") from error
        return Reply(reasoning=self.doc if feedback is None else "", calls=tuple(_tool_call(call) for call in calls))


def _tool_call(call: Call) -> ToolCall:
    return ToolCall(tool=call.tool, arguments=call.arguments)


def _readings(exchanges: Sequence[Exchange]) -> list[Reading]:
    return [_reading(exchange) for exchange in exchanges]


def _reading(exchange: Exchange) -> Reading:
    """What a call gives to the protocol: nothing if it was not run."""
    if exchange.is_error:
        return {"error": exchange.text}
    return dict(exchange.content or {}) if exchange.returned else {}
