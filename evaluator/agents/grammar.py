"""Reference agent for grammar worlds. It knows the grammar but not the sampled world, and reads only the prompt.

It is separate from `reference` because its search imports SciPy, which no other agent needs.
"""

from dataclasses import dataclass, field, replace
from threading import Event

from anyio import get_cancelled_exc_class, to_thread

from evaluator.agents.reference import ProtocolPlayer
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.records.episode import EpisodeKey
from scenes.protocol import ANSWER, Protocol
from scenes.worlds.predictions import Prediction
from scenes.worlds.protocols import SEARCH_SECONDS, blind_protocol


@dataclass(frozen=True, slots=True)
class GrammarAgent:
    """Plays grammar worlds: applies forces, finds the terms that explain the readings, and predicts the answers."""

    seconds: float = SEARCH_SECONDS
    """Processor time of the search [s]."""
    name: str = "grammar"
    """Name in records and tables."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_GrammarPlayer":
        """Return a player that sees only the prompt of the scene."""
        del key
        return _GrammarPlayer(self.seconds, briefing.prompt)


@dataclass(slots=True)
class _GrammarPlayer:
    seconds: float
    prompt: str
    player: ProtocolPlayer = field(init=False)
    predictions: list[Prediction] = field(default_factory=list[Prediction])
    halted: Event = field(default_factory=Event)

    def __post_init__(self) -> None:
        def solve(prompt: str) -> Protocol:
            """Generate calls that push each movable body towards many positions with many forces, and read it."""
            return blind_protocol(prompt, self.seconds, self.predictions.append, self.halted)

        self.player = ProtocolPlayer(solve, self.prompt)

    async def act(self, feedback: Feedback | None) -> Reply:
        """Return the next batch of calls, or the answer with a description of the law that explains the readings.

        The search runs in a thread, because it would otherwise block the event loop for up to `seconds`. The program
        ends when its threads have ended, so a cancelled search is stopped.

        Raises:
            AgentError: The prompt is not that of a grammar world.
        """
        try:
            reply = await to_thread.run_sync(self.player.reply, feedback, abandon_on_cancel=True)
        except get_cancelled_exc_class():
            self.halted.set()
            raise
        if self.predictions and any(call.tool == ANSWER for call in reply.calls):
            return replace(reply, reasoning=self.predictions[-1].says())
        return reply
