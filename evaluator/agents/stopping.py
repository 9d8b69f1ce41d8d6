"""Stopping policies, which advise an agent when to answer. They change an agent's feedback and nothing else.

A policy adds its advice to the note of the feedback. Grading, budget and tools stay the same, so runs with different
policies can be compared. The advice depends only on the replies and the feedback, and the agent's name includes the
policy's name. A transcript and the agent's name therefore determine what the agent read.
"""

import re
from dataclasses import dataclass, field
from typing import Protocol

from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply
from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey

POLICIES = ("always", "budget-aware", "confidence[:0.9]")
"""Values of `--stopping`."""
LAST_ITERATIONS = 2
"""Number of remaining iterations from which `budget-aware` asks for the answer."""
DEFAULT_THRESHOLD = 0.9
_STATED = re.compile(
    r"""confidence\b [\s*_`"':=-]* (?:\(0\s*(?:-|–|to)\s*1\))? [\s*_`"':=-]*
        (?:(?:is|of|at|now|level|about|score)\b [\s*_`"':=-]*)*
        (?P<number> \d+(?:\.\d+)? | \.\d+ ) (?P<percent> \s*%)?
        (?! [\d.]*\d | \s*/ | \s*out\b | \s*(?:-|–|to)\s*\d )""",
    re.IGNORECASE | re.VERBOSE,
)


class StoppingPolicy(Protocol):
    """Advises an agent after each of its turns."""

    @property
    def name(self) -> str:
        """Name in records, as `--stopping` takes it."""
        ...

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """Return the advice for the agent; empty for none.

        Args:
            reply: The agent's last turn.
            feedback: The results of that turn, and the remaining iterations.
        """
        ...


@dataclass(frozen=True, slots=True)
class BudgetAware:
    """Asks for the answer in the last iterations of the budget."""

    name: str = "budget-aware"

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """Ask for the answer in the last iterations."""
        del reply
        if feedback.remaining > LAST_ITERATIONS:
            return ""
        left = "This is your last iteration" if feedback.remaining == 1 else f"{feedback.remaining} iterations are left"
        return f"{left}: call answer now, with the best value you have."


@dataclass(frozen=True, slots=True)
class Confidence:
    """Asks an agent for its confidence in each reply, and for the answer once the confidence reaches the threshold."""

    threshold: float = DEFAULT_THRESHOLD

    @property
    def name(self) -> str:
        """`confidence:` and the threshold."""
        return f"confidence:{self.threshold:g}"

    def advice(self, reply: Reply, feedback: Feedback) -> str:
        """Ask for the answer if the confidence in the last reply reaches the threshold, otherwise for a confidence."""
        del feedback
        stated = stated_confidence(reply.reasoning)
        if stated is not None and stated >= self.threshold:
            return f"You stated a confidence of {stated:g}: call answer now."
        return (
            "In the reasoning of your next reply, state how confident you are that you can answer correctly now, from 0"
            " to 1, in this form: confidence: 0.5"
        )


def stated_confidence(reasoning: str) -> float | None:
    """The last confidence that a text states, from 0 to 1; None if it states none."""
    last = None
    for found in _STATED.finditer(reasoning):
        value = float(found["number"]) / (100 if found["percent"] else 1)
        last = value if 0 <= value <= 1 else last
    return last


@dataclass(frozen=True, slots=True)
class StoppingAgent:
    """Wraps an agent so that it receives the advice of a stopping policy."""

    inner: Agent
    policy: StoppingPolicy

    @property
    def name(self) -> str:
        """The inner agent's name, a plus sign, and the policy's name."""
        return f"{self.inner.name}+{self.policy.name}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_StoppingPlayer":
        """Return the inner agent's player, with the advice added to its feedback."""
        return _StoppingPlayer(self.inner.player(key, briefing), self.policy)


@dataclass(slots=True)
class _StoppingPlayer:
    inner: Player
    policy: StoppingPolicy
    last: Reply = field(default_factory=Reply)

    async def act(self, feedback: Feedback | None) -> Reply:
        if feedback is not None:
            note = "\n".join(filter(None, (feedback.note, self.policy.advice(self.last, feedback))))
            feedback = Feedback(feedback.exchanges, note, feedback.remaining)
        self.last = await self.inner.act(feedback)
        return self.last


def with_stopping(agent: Agent, text: str) -> Agent:
    """Wrap an agent in the policy that `--stopping` names. `always`, the default, returns the agent unchanged.

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
