"""The contract of agents. An agent makes a player for each episode; the player takes the turns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from evaluator.records.episode import EpisodeKey, Exchange, ToolCall, Usage

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
    """Everything that an agent learns before its first turn."""

    prompt: str
    """The opening prompt: the task and what is known about the scene."""
    tools: tuple[ToolDescription, ...]
    budget: int
    """Iterations it may use."""
    scene: Mapping[str, Any]
    """The facts of the prompt as data: the server's resource of the open scene; empty if it publishes none."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What an agent learns after a turn."""

    exchanges: Sequence[Exchange]
    """Its calls, and what each returned."""
    note: str
    """What was wrong with the turn as a whole, or other advice; often empty."""
    remaining: int
    """Iterations left, including the next one."""


@dataclass(frozen=True, slots=True)
class Reply:
    """One turn of an agent, which costs one iteration."""

    reasoning: str = ""
    calls: tuple[ToolCall, ...] = ()
    """Run in this order; `answer` ends the episode."""
    malformed: str = ""
    """Why the reply could not be read; if set, no call is run."""
    usage: Usage | None = None
    thought_chars: int = 0
    """Characters at the start of `reasoning` that are not the reply, but what the provider shows of the model's own
    reasoning."""


class Player(Protocol):
    """An agent in one episode."""

    async def act(self, feedback: Feedback | None) -> Reply:
        """Take a turn.

        Args:
            feedback: The returns of the previous turn; None at the first turn.

        Raises:
            AgentError: The agent cannot continue. The episode ends and counts.
            InfrastructureError: Something that the agent needs failed. The episode is played again.
        """
        ...


class Agent(Protocol):
    """Plays episodes turn by turn."""

    @property
    def name(self) -> str:
        """Name in records and tables."""
        ...

    def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
        """A new player for one episode.

        Args:
            key: Which episode. Randomness must follow from it, so that the episode can be played again.
            briefing: Everything that is known before the first turn.

        Raises:
            AgentError: The agent cannot play this episode.
        """
        ...
