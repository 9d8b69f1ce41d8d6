"""Stopping policies: when an agent is told that it should answer. They change what it is told, and nothing else.

A policy speaks through the note of the feedback, so grading, budget and tools stay the same and runs can be compared.
What it says follows from the replies and the feedback alone: the agent's name, which holds the policy's, and the
transcript say exactly what the agent was told.
"""

import re
from dataclasses import dataclass, field
from typing import Protocol

from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply
from evaluator.errors import UsageError
from evaluator.records import EpisodeKey

POLICIES = ("always", "budget-aware", "confidence[:0.9]")
"""What `--stopping` may say."""
LAST_ITERATIONS = 2
"""With so many iterations left, `budget-aware` asks for the answer."""
DEFAULT_THRESHOLD = 0.9
_STATED = re.compile(
    r"""confidence\b [\s*_`"':=-]* (?:\(0\s*(?:-|–|to)\s*1\))? [\s*_`"':=-]*
        (?:(?:is|of|at|now|level|about|score)\b [\s*_`"':=-]*)*
        (?P<number> \d+(?:\.\d+)? | \.\d+ ) (?P<percent> \s*%)?
        (?! [\d.]*\d | \s*/ | \s*out\b | \s*(?:-|–|to)\s*\d )""",
    re.IGNORECASE | re.VERBOSE,
)


class StoppingPolicy(Protocol):
    """What an agent is told after a turn, beyond what came of it."""

    @property
    def name(self) -> str:
        """Name in records: the one that `--stopping` takes."""
        ...

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """What to tell the agent; empty for nothing.

        Args:
            reply: What it did in the turn.
            feedback: What came of it, and how many iterations are left.
        """
        ...


@dataclass(frozen=True, slots=True)
class BudgetAware:
    """Asks for the answer when the budget runs out."""

    name: str = "budget-aware"

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """Ask in the last iterations."""
        del reply
        if feedback.remaining > LAST_ITERATIONS:
            return ""
        left = "This is your last iteration" if feedback.remaining == 1 else f"{feedback.remaining} iterations are left"
        return f"{left}: call answer now, with the best value you have."


@dataclass(frozen=True, slots=True)
class Confidence:
    """Asks for a confidence in each reply, and for the answer once it is high enough."""

    threshold: float = DEFAULT_THRESHOLD

    @property
    def name(self) -> str:
        """`confidence:` and the threshold."""
        return f"confidence:{self.threshold:g}"

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """Ask for the answer, or else for a confidence."""
        del feedback
        stated = stated_confidence(reply.reasoning)
        if stated is not None and stated >= self.threshold:
            return f"You stated a confidence of {stated:g}: call answer now."
        return (
            "In the reasoning of your next reply, state how confident you are that you can answer correctly now, from 0"
            " to 1, in this form: confidence: 0.5"
        )


def stated_confidence(reasoning: str) -> float | None:
    """The last confidence that a text states, 0 to 1; None if it states none."""
    last = None
    for found in _STATED.finditer(reasoning):
        value = float(found["number"]) / (100 if found["percent"] else 1)
        last = value if 0 <= value <= 1 else last
    return last


@dataclass(frozen=True, slots=True)
class StoppingAgent:
    """An agent under a stopping policy."""

    inner: Agent
    policy: StoppingPolicy

    @property
    def name(self) -> str:
        """The inner agent's name, and the policy's after a plus sign."""
        return f"{self.inner.name}+{self.policy.name}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_StoppingPlayer":
        """The inner agent's player, which will hear the policy too."""
        return _StoppingPlayer(self.inner.player(key, briefing), self.policy)


@dataclass(slots=True)
class _StoppingPlayer:
    inner: Player
    policy: StoppingPolicy
    last: Reply = field(default_factory=Reply)

    async def act(self, feedback: Feedback | None) -> Reply:
        if feedback is not None:
            told = [one for one in (feedback.note, self.policy.advice(self.last, feedback)) if one]
            feedback = Feedback(feedback.exchanges, "\n".join(told), feedback.remaining)
        self.last = await self.inner.act(feedback)
        return self.last


def with_stopping(agent: Agent, text: str) -> Agent:
    """The agent under the policy that `--stopping` names; under `always`, the default, the agent as it is.

    Raises:
        UsageError: There is no such policy.
    """
    kind, colon, rest = text.partition(":")
    match kind, bool(colon):
        case "always", False:
            return agent
        case "budget-aware", False:
            return StoppingAgent(agent, BudgetAware())
        case "confidence", False:
            return StoppingAgent(agent, Confidence())
        case "confidence", True:
            return StoppingAgent(agent, Confidence(_threshold(rest)))
        case _:
            raise UsageError(f"--stopping {text}: there is no such policy; the policies are {', '.join(POLICIES)}")


def _threshold(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value <= 1:
        raise UsageError(f"--stopping confidence:{text}: the threshold must be above 0 and at most 1, such as 0.9")
    return value
