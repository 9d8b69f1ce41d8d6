"""Participants: who plays the episodes of a run, and how.

Two kinds exist. An agent takes turns in the loop (`AgentParticipant`). A program drives itself and is watched from
outside (`evaluator.agents.external`).
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Protocol

from pydantic import JsonValue

from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.records.episode import Episode, EpisodeKey, Usage, Versions


class Participant(Protocol):
    """Plays the episodes of a run under one name."""

    @property
    def name(self) -> str:
        """Name in records and tables, different from that of every other participant of the run."""
        ...

    def facts(self) -> Mapping[str, JsonValue]:
        """What decides its results besides its name, for `run.json`. Holds no secrets; often empty."""
        ...

    def running(self) -> AbstractAsyncContextManager[object]:
        """The context in which it plays. Leaving it closes what its episodes share, such as connections."""
        ...

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Play one episode once.

        Args:
            laboratory: Where to open the episode.
            key: Which episode.
            versions: Recorded with it.
            used: Receives what each reply of a model used, also if the episode fails.

        Raises:
            InfrastructureError: Something that the episode needs failed; it has no outcome and may be played again.
            PermanentFailure: No episode of this participant can be played.
            UsageError: The participant cannot play in this laboratory.
        """
        ...


@dataclass(frozen=True, slots=True)
class AgentParticipant:
    """An agent whose turns the loop plays."""

    agent: Agent
    decisive: Mapping[str, JsonValue] = field(default_factory=dict[str, JsonValue])
    """Its `facts`."""
    owned: AbstractAsyncContextManager[object] = field(default_factory=nullcontext[None])
    """What is closed when it has stopped playing, such as the HTTP client of a model."""

    @property
    def name(self) -> str:
        """The agent's name."""
        return self.agent.name

    def facts(self) -> Mapping[str, JsonValue]:
        """What it was made with."""
        return self.decisive

    def running(self) -> AbstractAsyncContextManager[object]:
        """The context of what it owns."""
        return self.owned

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Play one episode, turn by turn."""
        async with laboratory.open(key.scene, key.seed) as client:
            return await play_episode(self.agent, client, key, versions, laboratory.toolboxes, used)

    def wrapped(self, wrap: Callable[[Agent], Agent]) -> "AgentParticipant":
        """The same participant with its agent wrapped: facts and what is owned stay those of the inner agent."""
        return replace(self, agent=wrap(self.agent))
