"""How likely a blind guess is right, from the key alone: no sampling, so that it is the same for every run.

The guess is that of the agent `blind`: one of the options, each as likely as the others, or for each number that is
asked for a size between 0.01 and 100, log-uniform.
"""

import math
from dataclasses import replace
from typing import NamedTuple

from pydantic import JsonValue

from evaluator.answers.grading import grade
from evaluator.answers.strict import AnswerKey, tolerance, wanted_number
from evaluator.records.episode import Verdict
from scenes.answer_spec import AnswerKind, AnswerSpec

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
