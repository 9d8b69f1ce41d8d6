"""An agent that makes the calls of recorded episodes again, in the same turns, whatever they return."""

from dataclasses import dataclass
from pathlib import Path

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError, UsageError
from evaluator.records import Episode, EpisodeKey, Outcome, Turn
from evaluator.store import RunFolder


@dataclass(frozen=True, slots=True)
class RecordedAgent:
    """Makes, in each episode, the calls of the record with the same key. The record's agent may be another."""

    name: str
    episodes: tuple[Episode, ...]

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_RecordedPlayer":
        """The player of the record with this key.

        Raises:
            AgentError: There is no such record, or there are records of several agents.
        """
        del briefing
        found = [episode for episode in self.episodes if episode.key.model_copy(update={"agent": key.agent}) == key]
        # If the folder is replayed as it is, the key names one of the recorded agents.
        found = [episode for episode in found if episode.key.agent == key.agent] or found
        if not found:
            raise AgentError(f"no transcript is stored for {_described(key)}")
        if len(found) > 1:
            agents = ", ".join(episode.key.agent for episode in found)
            raise AgentError(f"{len(found)} transcripts are stored for {_described(key)}, of {agents}")
        return _RecordedPlayer(found[0].turns)


@dataclass(slots=True)
class _RecordedPlayer:
    turns: tuple[Turn, ...]
    played: int = 0

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        if self.played == len(self.turns):
            raise AgentError("the stored transcript ends here")
        turn = self.turns[self.played]
        self.played += 1
        # The record of a malformed reply has no calls, so it is played as a reply without calls.
        return Reply(turn.reasoning, tuple(exchange.call for exchange in turn.exchanges))


def load_recorded(folder: Path) -> RecordedAgent:
    """The agent that plays the records of a run folder.

    Raises:
        UsageError: The folder holds no episode that was played.
        StoreError: A record is damaged.
    """
    stored = RunFolder(folder).episodes().values()
    episodes = tuple(episode for episode in stored if episode.outcome is not Outcome.INFRASTRUCTURE_ERROR)
    if not episodes:
        raise UsageError(f"{folder} holds no transcript to replay")
    return RecordedAgent(f"replay:{folder.name}", episodes)


def _described(key: EpisodeKey) -> str:
    return (
        f"scene {key.scene}, seed {key.seed}, budget {key.budget}, {key.prompting}, {key.protocol}, epoch {key.epoch}"
    )
