"""What an answer is worth to a trainer, and how likely a blind guess is right. Pure functions of an answer and its key.

The guess is that of the agent `blind`: one of the options, each as likely as the others, or for each number that is
asked for a size between 0.01 and 100, log-uniform.
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple, assert_never

from pydantic import JsonValue

from evaluator.answers.grading import grade, right_parts
from evaluator.answers.strict import AnswerKey, tolerance, wanted_number
from evaluator.records.episode import Verdict
from scenes import AnswerKind, AnswerSpec

GUESS_RANGE = (0.01, 100.0)
"""Range in which numbers are guessed."""


class Chance(NamedTuple):
    """What a blind guess is worth on average."""

    strict: float
    """Probability that it is right."""
    graded: float
    """Expected share of its parts that are right."""


def chance_at(form: AnswerKey, value: JsonValue) -> Chance:
    """What a blind guess is worth against a stored key.

    Args:
        form: A key of the same scene.
        value: The stored key; None while it is withheld, which leaves the other key of the scene.
    """
    if value is None:
        return blind_chance(form)
    try:
        return blind_chance(replace(form, value=tuple(value) if isinstance(value, list) else value))
    except ValueError:
        return blind_chance(form)  # the scene has asked for an answer of another form since


def blind_chance(key: AnswerKey) -> Chance:
    """What a blind guess is worth against a key."""
    options = key.spec.options
    if options:
        grades = [grade(option, key) for option in options]
        right = sum(found.strict is Verdict.CORRECT for found in grades)
        return Chance(right / len(options), math.fsum(found.graded or 0.0 for found in grades) / len(options))
    listed = isinstance(key.value, tuple)
    if listed and not (key.spec.kind is AnswerKind.NUMBERS and key.spec.labels):
        return Chance(0.0, 0.0)  # the guess is a single number
    shares = [_share(key, index) for index in range(len(key.parts))]
    return Chance(math.prod(shares), math.fsum(shares) / len(shares))


def chance_of_form(spec: AnswerSpec) -> float:
    """Probability that a blind guess is strictly right, from the form of the answer alone.

    It tells nothing of a key, so a trainer may know it. `blind_chance` differs from it where a key lies near the ends
    of the range of guesses, or where an absolute tolerance is the wider one.
    """
    if spec.options:
        return 1 / len(spec.options)
    if spec.kind is AnswerKind.NUMBER:
        numbers = 1
    elif spec.kind is AnswerKind.NUMBERS:
        numbers = len(spec.labels)
    else:
        numbers = 0
    lowest, highest = GUESS_RANGE
    width = math.log((1 + spec.rel_tol) / max(1 - spec.rel_tol, lowest / highest)) / math.log(highest / lowest)
    return min(width, 1.0) ** numbers if numbers else 0.0


def _share(key: AnswerKey, index: int) -> float:
    """Probability that a guessed number is within the tolerance of a part of the key."""
    wanted = wanted_number(key, index)
    if wanted is None:
        return 0.0
    allowed = tolerance(wanted, key)
    lowest, highest = GUESS_RANGE
    low, high = (min(max(float(wanted.value + end), lowest), highest) for end in (-allowed, allowed))
    return math.log(high / low) / math.log(highest / lowest)


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
