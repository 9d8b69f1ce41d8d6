"""The reference agent: plays a pack's own protocol through the public tools. Shows that a scene can be solved."""

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
    """Plays `solution.py` of the scene it is in."""

    scenes_dir: Path | None = None
    name: str = "reference"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ReferencePlayer":
        """Start the scene's protocol.

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
    return [
        {"error": one.text} if one.is_error else dict(one.content or {}) if one.returned else {} for one in exchanges
    ]
