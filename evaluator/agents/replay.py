"""An agent that plays stored transcripts again: the same calls in the same turns, whatever comes back."""

from dataclasses import dataclass
from pathlib import Path

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError, UsageError
from evaluator.records import Episode, EpisodeKey, Outcome, Turn
from evaluator.store import RunFolder


@dataclass(frozen=True, slots=True)
class ReplayAgent:
    """Plays for each episode the transcript stored under its key, whichever agent it is of."""

    name: str
    episodes: tuple[Episode, ...]

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ReplayPlayer":
        """The player of the episode's transcript.

        Raises:
            AgentError: None is stored, or several agents have one.
        """
        del briefing
        found = [one for one in self.episodes if one.key.model_copy(update={"agent": key.agent}) == key]
        # The agent of the key tells several apart when the folder is replayed as it stands.
        found = [one for one in found if one.key.agent == key.agent] or found
        if not found:
            raise AgentError(f"no transcript is stored for {_described(key)}")
        if len(found) > 1:
            agents = ", ".join(one.key.agent for one in found)
            raise AgentError(f"{len(found)} transcripts are stored for {_described(key)}, of {agents}")
        return _ReplayPlayer(found[0].turns)


@dataclass(slots=True)
class _ReplayPlayer:
    turns: tuple[Turn, ...]
    played: int = 0

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        if self.played == len(self.turns):
            raise AgentError("the stored transcript ends here")
        turn = self.turns[self.played]
        self.played += 1
        # A reply that could not be read left no calls: it is played as one without any.
        return Reply(turn.reasoning, tuple(one.call for one in turn.exchanges))


def load_replay(folder: Path) -> ReplayAgent:
    """The agent of a run folder's transcripts.

    Raises:
        UsageError: It holds none.
        StoreError: A record is damaged.
    """
    stored = RunFolder(folder).episodes().values()
    episodes = tuple(one for one in stored if one.outcome is not Outcome.INFRASTRUCTURE_ERROR)
    if not episodes:
        raise UsageError(f"{folder} holds no transcript to replay")
    return ReplayAgent(f"replay:{folder.name}", episodes)


def _described(key: EpisodeKey) -> str:
    return (
        f"scene {key.scene}, seed {key.seed}, budget {key.budget}, {key.prompting}, {key.protocol}, epoch {key.epoch}"
    )
