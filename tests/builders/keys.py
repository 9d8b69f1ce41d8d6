"""Builds answer keys, and combines strict and normalised grading of an answer into one verdict."""

from pydantic import JsonValue

from evaluator.answers.grading import grade, infer_spec
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import NormalisationClass, Verdict
from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar

NOTATION = NormalisationClass.OBJECT_NOTATION
ROUNDING = NormalisationClass.TRIVIAL_ROUNDING
CONCEPT = NormalisationClass.CONCEPTUAL
FORMAT = NormalisationClass.ANSWER_FORMAT

STRICT = "strict"
WRONG = "wrong"
Expected = str | NormalisationClass
"""`STRICT`, `WRONG`, or the class for which normalised grading forgives the answer."""


def number(value: float, unit: str | None = None, *, abs_tol: float = 0.0, rel_tol: float = 0.05) -> AnswerKey:
    return AnswerKey(value, AnswerSpec(kind=AnswerKind.NUMBER, unit=unit, abs_tol=abs_tol, rel_tol=rel_tol))


def numbers(*values: Scalar, unit: str | tuple[str, ...] | None = None, labels: tuple[str, ...] = ()) -> AnswerKey:
    return AnswerKey(values, AnswerSpec(kind=AnswerKind.NUMBERS, unit=unit, labels=labels))


def objects(value: Scalar | tuple[Scalar, ...], **names: str) -> AnswerKey:
    return AnswerKey(value, AnswerSpec(kind=AnswerKind.OBJECTS), names)


def choice(value: Scalar, *options: str, accept: tuple[str, ...] = (), **names: str) -> AnswerKey:
    return AnswerKey(value, AnswerSpec(kind=AnswerKind.CHOICE, options=options, accept=accept), names)


def text(value: str, *options: str, accept: tuple[str, ...] = ()) -> AnswerKey:
    return AnswerKey(value, AnswerSpec(kind=AnswerKind.TEXT, options=options, accept=accept))


def published(value: Scalar | tuple[Scalar, ...], problem_type: str = "calculation", **names: str) -> AnswerKey:
    return AnswerKey(value, infer_spec(value, problem_type), names)


def verdict_of(answer: JsonValue, key: AnswerKey) -> Expected:
    result = grade(answer, key)
    assert result.reason
    if result.strict is Verdict.CORRECT:
        assert (result.normalised, result.normalisation, result.graded) == (Verdict.CORRECT, None, 1.0)
        return STRICT
    if result.normalised is Verdict.CORRECT:
        assert result.normalisation is not None
        return result.normalisation
    assert result.normalisation is None
    return WRONG
