"""What an agent is: a factory of players, one for each episode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from evaluator.records import EpisodeKey, Exchange, ToolCall, Usage

ANSWER = "answer"
"""Name of the tool that ends an episode."""


@dataclass(frozen=True, slots=True)
class ToolDescription:
    """A tool as the server publishes it."""

    name: str
    description: str
    input_schema: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Briefing:
    """All an agent is told before its first turn."""

    prompt: str
    tools: tuple[ToolDescription, ...]
    budget: int
    scene: Mapping[str, Any]
    """The server's resource of the open scene, empty if it publishes none: the prompt's facts as data."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What an agent is told after a turn."""

    exchanges: Sequence[Exchange]
    note: str
    remaining: int
    """Iterations left, the coming one included."""


@dataclass(frozen=True, slots=True)
class Reply:
    """One turn of an agent."""

    reasoning: str = ""
    calls: tuple[ToolCall, ...] = ()
    malformed: str = ""
    """Why the reply could not be read; then there are no calls."""
    usage: Usage | None = None


class Player(Protocol):
    """An agent in one episode."""

    async def act(self, feedback: Feedback | None) -> Reply:
        """Take a turn.

        Args:
            feedback: What came of the turn before; None at the first.

        Raises:
            AgentError: The agent cannot go on.
            InfrastructureError: What the agent runs on failed.
        """
        ...


class Agent(Protocol):
    """Something that can play episodes."""

    @property
    def name(self) -> str:
        """Name in records and tables."""
        ...

    def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
        """A fresh player for one episode."""
        ...
