"""What an answer is worth to a trainer. Pure functions of an answer and its key; knows no episodes."""

from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never

from pydantic import JsonValue

from evaluator.answers.chance import chance_of_form
from evaluator.answers.grading import grade, right_parts
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Verdict


class Worth(StrEnum):
    """Which number of an `AnswerReward` counts."""

    STRICT = "strict"
    """1 if the answer is strictly correct, otherwise 0."""
    GRADED = "graded"
    """The share of sub-answers within tolerance, from 0 to 1."""
    CHANCE_CORRECTED = "chance-corrected"
    """1 if the answer is strictly correct, otherwise so far below 0 that blind guesses earn 0 on average."""


@dataclass(frozen=True, slots=True)
class AnswerReward:
    """What an answer is worth, in the three ways that a trainer may count it."""

    strict: float
    """1 if the answer is strictly correct, otherwise 0."""
    graded: float
    """The share of the parts of the key that are right, from 0 to 1."""
    parts: tuple[bool, ...]
    """For each part of the key, whether the answer gives it right; all False for an answer of another shape."""
    chance: float
    """Probability that a blind guess is strictly correct: 1/n for a choice of n, 1 % for a number to within 5 %.

    It follows from the form of the answer, not from the key.
    """

    @property
    def chance_corrected(self) -> float:
        """(strict - chance) / (1 - chance): 1 for a right answer, 0 on average for blind guesses.

        A task that a blind guess always solves has the value `strict`.
        """
        return self.strict if self.chance >= 1 else (self.strict - self.chance) / (1 - self.chance)

    def of(self, worth: Worth) -> float:
        """The number that counts."""
        match worth:
            case Worth.STRICT:
                return self.strict
            case Worth.GRADED:
                return self.graded
            case Worth.CHANCE_CORRECTED:
                return self.chance_corrected
            case _:
                assert_never(worth)


def answer_reward(answer: JsonValue, key: AnswerKey) -> AnswerReward:
    """What an answer is worth against its key. Never raises.

    Args:
        answer: Exactly as submitted; None for an episode without an answer, which is worth as much as a wrong one.
        key: Its key.
    """
    found = grade(answer, key)
    return AnswerReward(
        strict=float(found.strict is Verdict.CORRECT),
        graded=found.graded or 0.0,
        parts=right_parts(answer, key),
        chance=chance_of_form(key.spec),
    )


@dataclass(frozen=True, slots=True)
class RewardRule:
    """How the reward of an episode follows from its answer and its cost."""

    worth: Worth = Worth.STRICT
    per_iteration: float = 0.0
    """Taken off for each iteration."""
    per_call: float = 0.0
    """Taken off for each tool call, refused ones included."""

    def cost(self, iterations: int, calls: int) -> float:
        """What is taken off.

        Args:
            iterations: Replies of the agent.
            calls: Tool calls that reached the laboratory.
        """
        return self.per_iteration * iterations + self.per_call * calls

    def reward(self, answer: AnswerReward, iterations: int, calls: int) -> float:
        """The reward of one episode; below 0 if it cost more than its answer is worth."""
        return answer.of(self.worth) - self.cost(iterations, calls)
