"""Answer keys, and strict comparison with them: the answer must have the requested form and be within tolerance.

A free text, which only published packs ask for, is right if it is the key or consists of words of the key.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

from pydantic import JsonValue

from evaluator.answers.forms import Item, PlainNumber, as_item, plain_number, strict_items
from evaluator.answers.formula_keys import check_key, compare_formulas
from evaluator.answers.words import is_contained, is_object_id
from evaluator.records.episode import NormalisationClass
from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar

ZERO_ABS_TOL = 0.01
"""Absolute tolerance for keys that are 0, in the unit of the answer, because 5 % of 0 is 0.

It equals 5 % of the smallest other published key, 0.2 (scenes 93 and 99).
"""


_NOUNS = {AnswerKind.NUMBERS: "list of numbers", AnswerKind.OBJECTS: "list of objects", AnswerKind.TEXT: "text"}


@dataclass(frozen=True, slots=True)
class AnswerKey:
    """The right answer of one episode, and how to compare with it.

    Raises:
        ValueError: The value does not match its specification.
    """

    value: Scalar | tuple[Scalar, ...]
    spec: AnswerSpec
    objects: Mapping[str, str] = field(default_factory=dict[str, str])
    """Object id, such as `object_2` → public name."""
    steps: Mapping[str, float] = field(default_factory=dict[str, float])
    """Intermediate quantity → its value; not part of the answer."""

    def __post_init__(self) -> None:
        listed = isinstance(self.value, tuple)
        single = self.spec.kind in {AnswerKind.NUMBER, AnswerKind.TEXT, AnswerKind.FORMULA}
        if not self.parts or (listed and single) or (not listed and self.spec.kind is AnswerKind.NUMBERS):
            raise ValueError(f"the key {self.value!r} is no {_NOUNS.get(self.spec.kind, self.spec.kind.value)}")
        for part in self.parts:
            number = plain_number(part)
            if isinstance(part, bool) or not str(part).strip() or (number is None and not isinstance(part, str)):
                raise ValueError(f"{part!r} cannot be the key of any answer")
            # A published list may hold the id of an object beside numbers.
            is_named = self.spec.kind is AnswerKind.NUMBERS and is_object_id(str(part).strip().lower())
            if number is None and self.spec.kind in {AnswerKind.NUMBER, AnswerKind.NUMBERS} and not is_named:
                raise ValueError(f"the key {part!r} is no number")
        units = self.spec.unit if isinstance(self.spec.unit, tuple) else ()
        for what, given in (("unit", units), ("label", self.spec.labels)):
            if given and len(given) != len(self.parts):
                raise ValueError(f"the key {self.value!r} needs one {what} for each of its parts, not {len(given)}")
        for pattern in self.spec.accept:
            try:
                re.compile(pattern)
            except re.error as error:
                raise ValueError(f"the pattern {pattern!r} cannot be read: {error}") from error
        if self.spec.kind is AnswerKind.FORMULA:
            check_key(str(self.value), self.spec.variables)

    @property
    def parts(self) -> tuple[Scalar, ...]:
        """The parts of the key; a scalar key has one part."""
        return self.value if isinstance(self.value, tuple) else (self.value,)


class Finding(NamedTuple):
    """The result of comparing one part of an answer."""

    right: bool
    reason: str
    forgiven: NormalisationClass | None = None


def joined_reasons(findings: Sequence[Finding]) -> str:
    """The reasons of the findings, without repetition."""
    return "; ".join(dict.fromkeys(finding.reason for finding in findings))


def strict_parts(answer: JsonValue, key: AnswerKey) -> list[Item] | None:
    """The parts of an answer that has as many parts as the key; None otherwise."""
    if isinstance(key.value, tuple):
        items = strict_items(answer)
        return items if items is not None and len(items) == len(key.value) else None
    item = as_item(answer)
    return None if item is None else [item]


def strict_finding(item: Item, key: AnswerKey, index: int) -> Finding:
    """Compare one part of an answer with its key, strictly."""
    if key.spec.kind is AnswerKind.FORMULA:
        right, reason = compare_formulas(str(item), str(key.value), key.spec)
        return Finding(right, reason)
    wanted = wanted_number(key, index)
    if wanted is None:
        return _compare_words(item, key, index)
    got = plain_number(item)
    if got is None:
        return Finding(right=False, reason=f"{quoted(item)} is not a plain number")
    return compare_numbers(got.value, wanted, key)


def _compare_words(item: Item, key: AnswerKey, index: int) -> Finding:
    said, meant = exact_text(item), exact_text(key.parts[index])
    accepted = {meant, f"object_{meant}"} if _is_numbered_object(key, meant) else {meant}
    if said in accepted:
        return Finding(right=True, reason=f"{quoted(item)} is the key")
    if key.spec.kind is AnswerKind.TEXT and is_contained(said, meant, key.spec.options):
        return Finding(right=True, reason=f"{quoted(item)} stands in the key as whole words")
    return Finding(right=False, reason=f"{quoted(item)} is not {quoted(key.parts[index])}")


def wanted_number(key: AnswerKey, index: int) -> PlainNumber | None:
    """A part of the key as a number; None if the part is not compared as a number."""
    return plain_number(key.parts[index]) if key.spec.kind in {AnswerKind.NUMBER, AnswerKind.NUMBERS} else None


def _is_numbered_object(key: AnswerKey, meant: str) -> bool:
    """Whether the key is the bare number of an object, while the prompt asks for the form `object_2`."""
    return key.spec.kind is AnswerKind.OBJECTS and f"object_{meant}" in key.objects


def compare_numbers(got: Fraction, wanted: PlainNumber, key: AnswerKey) -> Finding:
    """Compare by equation 1 of the paper, on exact decimals: |got - wanted| <= abs_tol + rel_tol * |wanted|."""
    allowed = tolerance(wanted, key)
    right = abs(got - wanted.value) <= allowed
    return Finding(
        right, f"{_short(got)} is {'within' if right else 'outside'} {_short(allowed)} of {_short(wanted.value)}"
    )


def tolerance(wanted: PlainNumber, key: AnswerKey) -> Fraction:
    """How far an answer may be from a part of the key, in the unit of the answer.

    Where the key is 0 and the pack states no absolute tolerance, it is `ZERO_ABS_TOL`.
    """
    return allowed_distance(wanted.value, key.spec.rel_tol, key.spec.abs_tol)


def allowed_distance(wanted: Fraction, rel_tol: float, abs_tol: float) -> Fraction:
    """abs_tol + rel_tol * |wanted|, exactly; with `ZERO_ABS_TOL` if that would be 0."""
    floor = abs_tol or (ZERO_ABS_TOL if wanted == 0 else 0.0)
    return Fraction(repr(floor)) + Fraction(repr(rel_tol)) * abs(wanted)


def exact_text(item: Item) -> str:
    """The text that is compared for an answer in words; a whole JSON number is written without a decimal point."""
    if isinstance(item, str):
        return item.strip().lower()
    number = plain_number(item)
    if number is None:
        return ""
    return str(number.value.numerator) if number.value.denominator == 1 else number.text


def _short(number: Fraction) -> str:
    if number.denominator == 1 and abs(number) < 10**15:
        return str(number.numerator)
    try:
        return f"{float(number):.6g}"
    except OverflowError:
        return "a number beyond all bounds"


def quoted(item: Item) -> str:
    """An item in quotes, shortened, for use in a reason."""
    text = str(item)[:60] if isinstance(item, str) else exact_text(item)
    return f"{text!r}"
