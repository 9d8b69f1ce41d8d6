"""Right or wrong, and why: pure functions from an answer and its key to a grade. Knows no files, agents or engine.

Three verdicts on one answer. *Strict*: the answer in the form that was asked for, within tolerance. *Graded*: the share
of its parts that are strictly right. *Normalised*: a strict fail forgiven for one of four documented reasons. No rule
looks inside an answer for the key, so an answer that says several things, or nothing, is wrong.
"""

from pydantic import JsonValue

from evaluator.answers.forgiven import forgive
from evaluator.answers.forms import MAX_CHARS, is_too_long, plain_number
from evaluator.answers.strict import AnswerKey, Finding, strict_finding, strict_parts, told
from evaluator.answers.words import is_object_id
from evaluator.records import Episode, Grade, Outcome, Verdict
from scenes.pack import AnswerKind, AnswerSpec, Scalar

__all__ = ["GRADER_VERSION", "AnswerKey", "grade", "grade_episode", "grade_missing", "infer_spec"]

GRADER_VERSION = "1"
"""Changes with every change of a verdict; stored beside each grade."""

ZERO_ABS_TOL = 0.01
"""Absolute tolerance of published keys that are 0, for which 5 % means nothing.

The smallest other published key is 0.2 (scenes 93 and 99), whose 5 % is 0.01: a key of 0 is held as tightly as that.
"""

_NUMERIC_TYPES = frozenset({"calculation", "computation"})


def infer_spec(answer: Scalar | tuple[Scalar, ...], problem_type: str) -> AnswerSpec:
    """Answer type of a published pack, which declares none.

    A whole number is a quantity only in a `calculation` or `computation`. In every other type it stands for an object
    or for an option told in the task's text: a choice, compared exactly. No unit is declared, so none can be checked,
    and numbers written with one are not forgiven.
    """
    parts = answer if isinstance(answer, tuple) else (answer,)
    listed = isinstance(answer, tuple)
    numbers = [number.value for part in parts if (number := plain_number(part)) is not None]
    if not numbers:
        if all(is_object_id(str(part).strip().lower()) for part in parts):
            return AnswerSpec(kind=AnswerKind.OBJECTS)
        return AnswerSpec(kind=AnswerKind.CHOICE if listed else AnswerKind.TEXT)
    if _is_whole(answer) and problem_type.strip().lower() not in _NUMERIC_TYPES:
        return AnswerSpec(kind=AnswerKind.CHOICE)
    return AnswerSpec(
        kind=AnswerKind.NUMBERS if listed else AnswerKind.NUMBER, abs_tol=ZERO_ABS_TOL if 0 in numbers else 0.0
    )


def _is_whole(answer: Scalar | tuple[Scalar, ...]) -> bool:
    """Tell whether a key is written as a whole number; 2.0 is a measured quantity."""
    return isinstance(answer, int) or (isinstance(answer, str) and answer.strip().lstrip("+-").isdecimal())


def grade_episode(episode: Episode, key: AnswerKey) -> Grade:
    """Grade what an episode left: its answer, or the lack of one."""
    if episode.outcome is Outcome.ANSWERED:
        return grade(episode.answer, key)
    return grade_missing(episode.outcome)


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
    """Compare an answer, verbatim as submitted, with its key. Never raises, whatever was submitted."""
    if is_too_long(answer):
        return _wrong(f"longer than {MAX_CHARS} characters or parts")
    items = strict_parts(answer, key)
    if items is None:
        findings, graded = [Finding(right=False, reason=_misfit(key))], 0.0
    else:
        findings = [strict_finding(item, key, index) for index, item in enumerate(items)]
        graded = sum(finding.right for finding in findings) / len(findings)
    if all(finding.right for finding in findings):
        reason = told(findings)
        return Grade(strict=Verdict.CORRECT, graded=graded, normalised=Verdict.CORRECT, reason=reason)
    forgiven = forgive(answer, key)
    if forgiven is None:
        return _wrong(told([finding for finding in findings if not finding.right]), graded)
    return Grade(
        strict=Verdict.INCORRECT,
        graded=graded,
        normalised=Verdict.CORRECT,
        normalisation=forgiven.forgiven,
        reason=forgiven.reason,
    )


def _wrong(reason: str, graded: float = 0.0) -> Grade:
    return Grade(strict=Verdict.INCORRECT, graded=graded, normalised=Verdict.INCORRECT, reason=reason)


def _misfit(key: AnswerKey) -> str:
    return f"not a list of {len(key.parts)}" if isinstance(key.value, tuple) else "not a single answer"
