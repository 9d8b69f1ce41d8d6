"""Verdicts by the paper's Eq. 1, and the reasons why a logged verdict differs from ours. Pure functions."""

import math
import re
from enum import StrEnum

from pydantic import JsonValue

from evaluator.original.logs import LoggedVerdict

_REL_TOL = 0.05
"""Eq. 1 of the paper: a number is right within 5 % of the key."""
_THEIR_ABS_TOL = 0.1
"""The absolute tolerance that the authors' program uses instead."""
_SEPARATORS = re.compile(r"[,;\s]+")


class Disagreement(StrEnum):
    """Why two verdicts on one answer differ."""

    OTHER_ANSWER = "another answer was read from the reply"
    SAME_TEXT = "the very text of the key, marked wrong"
    TOLERANCE = "within 5 % of the key, marked wrong"
    WORDING = "strictly right in words, marked wrong"
    FORM = "right by normalised grading only, marked wrong"
    FORGIVEN = "right by normalised grading only, marked right"
    SIGN = "wrong sign, marked right"
    PART = "a part of the key, marked right"
    MORE = "more values than the key has, marked right"
    FAR = "more than 5 % off but within 0.1, marked right"
    WORDS = "words, for a key that is in numbers now, marked right"
    OTHER_KEY = "marked right, though no rule matches it with this key"


class Eq1Disagreement(StrEnum):
    """Why Eq. 1 and our strict verdict differ."""

    CHOICE = "a number near one that stands for a choice"
    ZERO = "a key of 0, of which 5 % is nothing"
    UNEXPLAINED = "unexplained"


def eq1(answer: JsonValue, key: JsonValue) -> bool | None:
    """Whether every number of an answer is right by Eq. 1, |â - a| ≤ 0.05 |a|; None if a value is not a number."""
    got, want = numbers(answer), numbers(key)
    if got is None or want is None:
        return None
    return len(got) == len(want) and all(abs(a - b) <= _REL_TOL * abs(b) for a, b in zip(got, want, strict=True))


def numbers(value: JsonValue) -> list[float] | None:
    """The numbers in a value or list; None if it has anything else."""
    if isinstance(value, list):
        parts = [numbers(item) for item in value]
        return None if any(part is None or len(part) != 1 for part in parts) else [part[0] for part in parts if part]
    written = [part for part in _SEPARATORS.split(str(value).strip(" \t\r\n[]()")) if part]
    try:
        found = [float(part) for part in written]
    except ValueError:
        return None
    return found if found and all(map(math.isfinite, found)) else None


def why_other_verdict(
    logged: LoggedVerdict, answer: JsonValue, key: JsonValue, *, strict: bool, normalised: bool
) -> Disagreement | None:
    """Why a logged verdict differs from ours; None if it does not.

    Args:
        logged: The verdict and the answer in the log.
        answer: The answer that we parsed from the same replies; None if there was none.
        key: The key of the pack.
        strict: Our strict verdict.
        normalised: Our normalised verdict.
    """
    if logged.right == strict == (strict or normalised):
        return None
    if not _same_answer(logged.answer, answer):
        return Disagreement.OTHER_ANSWER
    if normalised and not strict:
        return Disagreement.FORGIVEN if logged.right else Disagreement.FORM
    got, want = numbers(logged.answer), numbers(key)
    if logged.right:
        return Disagreement.WORDS if got is None else _why_marked_right(got, want or [])
    if _plain(logged.answer) == _plain(logged.key):
        return Disagreement.SAME_TEXT
    return Disagreement.WORDING if got is None else Disagreement.TOLERANCE


def _why_marked_right(got: list[float], want: list[float]) -> Disagreement:
    if len(got) < len(want):
        return Disagreement.PART
    if len(got) > len(want):
        return Disagreement.MORE
    if eq1([abs(number) for number in got], [abs(number) for number in want]):
        return Disagreement.SIGN
    near = all(abs(a - b) < _THEIR_ABS_TOL for a, b in zip(got, want, strict=True))
    return Disagreement.FAR if near else Disagreement.OTHER_KEY


def why_other_than_eq1(by_eq1: bool, strict: bool, key: JsonValue, *, is_choice: bool) -> Eq1Disagreement | None:
    """Why our strict verdict differs from that of Eq. 1; None if it does not."""
    if by_eq1 == strict:
        return None
    if is_choice:
        return Eq1Disagreement.CHOICE
    return Eq1Disagreement.ZERO if 0 in (numbers(key) or []) else Eq1Disagreement.UNEXPLAINED


def _same_answer(logged: str, answer: JsonValue) -> bool:
    """Whether the log's answer, which is written as Python prints it, equals the answer that we parsed."""
    if answer is None:
        return logged == "None"
    return _plain(logged) == _plain(answer) or (numbers(logged) is not None and numbers(logged) == numbers(answer))


def _plain(value: JsonValue) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return re.sub(r"\s+", "", text.strip(" []()")).lower()
