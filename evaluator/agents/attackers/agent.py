"""An attacker as an agent that plays a run."""

from dataclasses import dataclass

from evaluator.agents.attackers.strategies import ATTACKERS
from evaluator.agents.protocol_player import ProtocolPlayer
from evaluator.episode.player import Briefing
from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey


@dataclass(frozen=True, slots=True)
class AttackerAgent:
    """Plays one of the generic attackers in every scene."""

    strategy: str
    """A name in `ATTACKERS`."""

    def __post_init__(self) -> None:
        if self.strategy not in ATTACKERS:
            raise UsageError(
                f"--agent attacker:{self.strategy}: there is no such attacker; they are {', '.join(ATTACKERS)}"
            )

    @property
    def name(self) -> str:
        """`attacker:` and the name of the strategy."""
        return f"attacker:{self.strategy}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """A player who knows only the opening prompt."""
        del key
        return ProtocolPlayer(ATTACKERS[self.strategy], briefing.prompt)
