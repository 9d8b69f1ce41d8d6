"""Grades an answer against its key, with a reason. Pure functions, without files, agents or engine.

An answer gets three verdicts. *Strict*: it has the requested form and is within tolerance. *Graded*: the share of its
parts that are strictly right. *Normalised*: it is strictly right, or accepted for one of four documented reasons. No
rule searches an answer for the key, so an answer with several values, or none, is wrong.
"""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from pydantic import JsonValue

from evaluator.answers.forgiven import forgive
from evaluator.answers.forms import MAX_CHARS, as_item, is_too_long, plain_number
from evaluator.answers.strict import (
    ZERO_ABS_TOL,
    AnswerKey,
    Finding,
    allowed_distance,
    is_object_id,
    joined_reasons,
    strict_finding,
    strict_parts,
)
from evaluator.records.episode import Episode, Grade, Outcome, Verdict
from scenes import AnswerKind, AnswerSpec, Scalar

REL_TOL = 0.05
"""Relative tolerance of every intermediate quantity."""


def stated_steps(episode: Episode) -> Mapping[str, Any]:
    """Return `steps` of the accepted answer, unchanged; empty if it has none, or if there is no accepted answer."""
    if episode.outcome is not Outcome.ANSWERED:
        return {}
    accepted = (
        exchange.call
        for turn in episode.turns
        for exchange in turn.exchanges
        if exchange.call.tool == "answer" and exchange.returned and not exchange.is_error
    )
    call = next(accepted, None)
    return {} if call is None else call.arguments.get("steps") or {}


def grade_steps(episode: Episode, values: Mapping[str, float]) -> dict[str, bool] | None:
    """Whether the answer contains each intermediate quantity of the scene, within 5 % of its value.

    Args:
        episode: The recorded episode.
        values: Intermediate quantity → value.

    Returns:
        Quantity → whether it is right; None if the scene names none, or if an infrastructure error ended the episode.
    """
    if not values or episode.outcome is Outcome.INFRASTRUCTURE_ERROR:
        return None
    stated = stated_steps(episode)
    return {name: _is_right(stated.get(name), value) for name, value in values.items()}


def _is_right(stated: Any, value: float) -> bool:
    item = as_item(stated)
    number = None if item is None else plain_number(item)
    wanted = Fraction(repr(value))
    return number is not None and abs(number.value - wanted) <= allowed_distance(wanted, REL_TOL, 0.0)


GRADER_VERSION = "4"
"""Version of the grading rules, stored with each grade; incremented whenever a verdict can change."""

_NUMERIC_TYPES = frozenset({"calculation", "computation"})


def listed_numbers(answer: Scalar | tuple[Scalar, ...]) -> Scalar | tuple[Scalar, ...]:
    """Convert a published key with several numbers in one string, such as `4.0, 79.6`, to a tuple."""
    if not isinstance(answer, str) or "," not in answer:
        return answer
    parts = tuple(part.strip() for part in answer.strip().removeprefix("[").removesuffix("]").split(","))
    return parts if all(plain_number(part) is not None for part in parts) else answer


def infer_spec(answer: Scalar | tuple[Scalar, ...], problem_type: str) -> AnswerSpec:
    """Infer the answer specification of a published pack, which declares none.

    A whole number is a quantity only in a `calculation` or `computation`. In every other problem type it is the number
    of an object or of an option in the task, and is compared exactly as a choice. Without a declared unit, units cannot
    be checked, and normalised grading rejects a number with a unit.
    """
    parts = answer if isinstance(answer, tuple) else (answer,)
    listed = isinstance(answer, tuple)
    numbers = [number.value for part in parts if (number := plain_number(part)) is not None]
    words = [str(part).strip().lower() for part in parts if plain_number(part) is None]
    if not all(map(is_object_id, words)):
        return AnswerSpec(kind=AnswerKind.CHOICE if listed else AnswerKind.TEXT)
    if not numbers:
        return AnswerSpec(kind=AnswerKind.OBJECTS)
    if _is_whole(answer) and problem_type.strip().lower() not in _NUMERIC_TYPES:
        return AnswerSpec(kind=AnswerKind.CHOICE)
    return AnswerSpec(
        kind=AnswerKind.NUMBERS if listed else AnswerKind.NUMBER, abs_tol=ZERO_ABS_TOL if 0 in numbers else 0.0
    )


def _is_whole(answer: Scalar | tuple[Scalar, ...]) -> bool:
    """Whether a key is written as a whole number; 2.0 counts as a measured quantity."""
    return isinstance(answer, int) or (isinstance(answer, str) and answer.strip().lstrip("+-").isdecimal())


def grade_episode(episode: Episode, key: AnswerKey) -> Grade:
    """Grade an episode by its answer, or by its outcome if there is no answer."""
    found = grade(episode.answer, key) if episode.outcome is Outcome.ANSWERED else grade_missing(episode.outcome)
    steps = grade_steps(episode, key.steps)
    return found if steps is None else found.model_copy(update={"steps": steps})


def grade_missing(outcome: Outcome) -> Grade:
    """Grade an episode without an answer.

    Raises:
        ValueError: The episode was answered.
    """
    if outcome is Outcome.ANSWERED:
        raise ValueError("an answered episode is graded by its answer")
    if outcome is Outcome.INFRASTRUCTURE_ERROR:
        reason = "the laboratory or the provider failed; says nothing about the agent"
        return Grade(strict=Verdict.UNSCORED, graded=None, normalised=Verdict.UNSCORED, reason=reason)
    return _wrong(f"no answer: {outcome.value}")


def grade(answer: JsonValue, key: AnswerKey) -> Grade:
    """Grade an answer, unchanged from its submission, against its key. Never raises."""
    if is_too_long(answer):
        return _wrong(f"longer than {MAX_CHARS} characters or parts")
    findings = _findings(answer, key)
    graded = sum(finding.right for finding in findings) / len(findings)
    if all(finding.right for finding in findings):
        reason = joined_reasons(findings)
        return Grade(strict=Verdict.CORRECT, graded=graded, normalised=Verdict.CORRECT, reason=reason)
    forgiven = forgive(answer, key)
    if forgiven is None:
        return _wrong(joined_reasons([finding for finding in findings if not finding.right]), graded)
    return Grade(
        strict=Verdict.INCORRECT,
        graded=graded,
        normalised=Verdict.CORRECT,
        normalisation=forgiven.forgiven,
        reason=forgiven.reason,
    )


def right_parts(answer: JsonValue, key: AnswerKey) -> tuple[bool, ...]:
    """Return for each part of the key whether it is answered strictly right; all False if the answer has another shape.

    `grade` counts the same parts. Never raises.
    """
    findings = [] if is_too_long(answer) else _findings(answer, key)
    right = tuple(finding.right for finding in findings)
    return right if len(right) == len(key.parts) else (False,) * len(key.parts)


def _findings(answer: JsonValue, key: AnswerKey) -> list[Finding]:
    """Compare each part of an answer with the key; one finding if the answer has another shape than the key."""
    items = strict_parts(answer, key)
    if items is None:
        return [Finding(right=False, reason=_wrong_shape(key))]
    return [strict_finding(item, key, index) for index, item in enumerate(items)]


def _wrong(reason: str, graded: float = 0.0) -> Grade:
    return Grade(strict=Verdict.INCORRECT, graded=graded, normalised=Verdict.INCORRECT, reason=reason)


def _wrong_shape(key: AnswerKey) -> str:
    return f"not a list of {len(key.parts)}" if isinstance(key.value, tuple) else "not a single answer"
