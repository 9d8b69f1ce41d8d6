"""Rewards for training, and the probability that a blind guess is right. Pure functions of an answer and its key.

A blind guess is that of the agent `blind`: a uniformly random option, or for each requested number a log-uniform
random value between 0.01 and 100.
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
"""Range of numeric guesses."""


class Chance(NamedTuple):
    """Expected scores of a blind guess."""

    strict: float
    """Probability that it is strictly right."""
    graded: float
    """Expected share of its parts that are right."""


def chance_at(form: AnswerKey, value: JsonValue) -> Chance:
    """Return the expected scores of a blind guess against a stored key.

    Args:
        form: The key of the same scene at some other seed.
        value: The stored key; None if it is withheld, in which case `form` is used.
    """
    if value is None:
        return blind_chance(form)
    try:
        return blind_chance(replace(form, value=tuple(value) if isinstance(value, list) else value))
    except ValueError:
        return blind_chance(form)  # the scene has changed its answer form since the key was stored


def blind_chance(key: AnswerKey) -> Chance:
    """Return the expected scores of a blind guess against a key."""
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
    """Return the probability that a blind guess is strictly right, computed from the form of the answer alone.

    It reveals nothing about a key, so a trainer may know it. `blind_chance` differs from it where a key lies near the
    ends of the guessing range, or where the absolute tolerance exceeds the relative one.
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
    """A rule for the value of an answer."""

    STRICT = "strict"
    """1 if the answer is strictly correct, otherwise 0."""
    GRADED = "graded"
    """The share of sub-answers within tolerance, from 0 to 1."""
    CHANCE_CORRECTED = "chance-corrected"
    """1 if the answer is strictly correct; otherwise negative, so that blind guesses earn 0 on average."""


@dataclass(frozen=True, slots=True)
class AnswerReward:
    """The value of an answer under each of the three rules (`Worth`) that a trainer can choose."""

    strict: float
    """1 if the answer is strictly correct, otherwise 0."""
    graded: float
    """The share of the parts of the key that are right, from 0 to 1."""
    parts: tuple[bool, ...]
    """For each part of the key, whether it is answered right; all False for an answer of another shape."""
    chance: float
    """Probability that a blind guess is strictly correct: 1/n for a choice of n, 1 % for a number to within 5 %.

    It depends on the form of the answer and not on the key.
    """

    @property
    def chance_corrected(self) -> float:
        """(strict - chance) / (1 - chance): 1 for a right answer, 0 on average for blind guesses.

        If every blind guess is right (chance 1), the value is `strict`.
        """
        return self.strict if self.chance >= 1 else (self.strict - self.chance) / (1 - self.chance)

    def of(self, worth: Worth) -> float:
        """Return the value under a rule."""
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
    """Compute the reward of an answer. Never raises.

    Args:
        answer: The answer, unchanged from its submission; None for an episode without one, which counts as wrong.
        key: The answer key.
    """
    parts = right_parts(answer, key)
    return AnswerReward(
        strict=float(all(parts)), graded=sum(parts) / len(parts), parts=parts, chance=chance_of_form(key.spec)
    )


@dataclass(frozen=True, slots=True)
class RewardRule:
    """Converts the value of an answer and the cost of an episode to a reward."""

    worth: Worth = Worth.STRICT
    per_iteration: float = 0.0
    """Deducted for each iteration."""
    per_call: float = 0.0
    """Deducted for each tool call, including refused calls."""

    def cost(self, iterations: int, calls: int) -> float:
        """Return the cost of an episode, which is subtracted from the value of its answer.

        Args:
            iterations: Number of replies of the agent.
            calls: Number of tool calls that the server received.
        """
        return self.per_iteration * iterations + self.per_call * calls

    def reward(self, answer: AnswerReward, iterations: int, calls: int) -> float:
        """Return the reward of one episode; negative if the cost exceeds the value of the answer."""
        return answer.of(self.worth) - self.cost(iterations, calls)
