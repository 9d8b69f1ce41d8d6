"""Answer keys, and strict grading: the answer must have the requested form and be within tolerance.

Free text, which only published packs request, is right if it equals the key or consists of consecutive words of it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from pydantic import JsonValue

from evaluator.answers.forms import Item, PlainNumber, as_item, plain_number, strict_items
from evaluator.answers.formula import check_key, compare_formulas
from evaluator.records.episode import NormalisationClass
from scenes import AnswerKind, AnswerSpec, Scalar

_WORD = re.compile(r"[^\W_]+(?:[.'’-][^\W_]+)*|_")
_NEGATIONS = frozenset(
    re.findall(
        r"\w+",
        """
        not no non never neither nor none nothing without cannot except unless hardly rather instead false wrong
        incorrect
        """,
    )
)
_EMPTY_WORDS = frozenset(
    re.findall(
        r"\w+",
        """
        a an and any are as at be been both but by can could do does did for from had has have he her his how i if in
        into is it its just may might more most much of off on one only or other our out over same she should so some
        such than that the their them then there these they this those to too under up very was we were what when
        where which while who will with would you your answer object objects body bodies scene yes
        """,
    )
)
_OBJECT_ID = re.compile(r"object_(?P<number>[0-9]{1,6})")
_LEADING_ZEROS = re.compile(r"^(object ?)0+(?=[1-9])")
_OPTION = re.compile(r"(?:(?:case|option) ?#?|#) ?(0|[1-9][0-9]{0,2})", re.IGNORECASE)
_ORDINAL = re.compile(r"(?:the )?([1-9][0-9]{0,2})(st|nd|rd|th)", re.IGNORECASE)
_TWO_NAMES = re.compile(r"(?P<first>[^()]+) \((?P<second>[^()]+)\)")


def words_of(text: str) -> list[str]:
    """Split a text into lower-case words without punctuation; a hyphenated word is one word."""
    return [word for word in _WORD.findall(text.lower()) if word != "_"]


def _negations(words: Sequence[str]) -> int:
    return sum(word in _NEGATIONS or word.startswith("non-") or word.endswith(("n't", "n’t")) for word in words)


def is_contained(answer: str, key: str, options: Sequence[str] = ()) -> bool:
    """Whether the answer's words occur in the key as a contiguous sequence with a content word.

    A content word has letters and is neither a function word nor a negation. Three further conditions separate
    different answers: every number in the key must be in the answer (`ball` is not `ball 2`); both must have equally
    many negations (`oscillates` does not match `no longer oscillates`); and the words must not occur in another option.
    """
    said, meant = words_of(answer), words_of(key)
    if not _occurs_in(said, meant) or _negations(said) != _negations(meant):
        return False
    if not any(_is_content(word) for word in said) or {word for word in meant if word[0].isdigit()} - {*said}:
        return False
    other_options = [words for words in map(words_of, options) if words != meant]
    return not any(_occurs_in(said, words) for words in other_options)


def _is_content(word: str) -> bool:
    return len(word) > 1 and word[0].isalpha() and word not in _EMPTY_WORDS and word not in _NEGATIONS


def _occurs_in(said: Sequence[str], meant: Sequence[str]) -> bool:
    return bool(said) and any(
        list(meant[start : start + len(said)]) == list(said) for start in range(len(meant) - len(said) + 1)
    )


def is_object_id(text: str) -> bool:
    """Whether a text is an object id in the form that the prompt asks for, such as `object_2`."""
    return _OBJECT_ID.fullmatch(text) is not None


def named_object(text: str, objects: Mapping[str, str]) -> str | None:
    """Return the id of the object that a text names; None if it names no object, or more than one.

    Args:
        text: A number (`2`, `#2`), an id (`object_2`, `Object 2`, `object_02`), a public name (`cart_2`), or two of
            these for the same object, the second in brackets.
        objects: Object id → public name.
    """
    folded = _folded(text)
    pair = _TWO_NAMES.fullmatch(folded)
    if pair is not None:
        first, second = named_object(pair["first"], objects), named_object(pair["second"], objects)
        return first if first == second else None
    named = [object_id for object_id, name in objects.items() if folded in _notations(object_id, name)]
    return named[0] if len(named) == 1 else None


def _notations(object_id: str, name: str) -> set[str]:
    folded = _folded(object_id)
    forms = {folded, _folded(name)} - {""}
    numbered = _OBJECT_ID.fullmatch(object_id)
    return forms | {numbered["number"], folded.replace(" ", "")} if numbered else forms


def _folded(text: str) -> str:
    if re.match(r"\s*[-\N{MINUS SIGN}]\s*#?\s*\d", text):
        return text  # a negative number is not an object id
    folded = " ".join(re.split(r"[\s_-]+", text.lower().strip(" _-\t\r\n")))
    return _LEADING_ZEROS.sub(r"\1", re.sub(r"^(object )?# ?(?=[0-9])", r"\1", folded))


def named_option(text: str, options: Sequence[str]) -> str | None:
    """Return the option that `case 7`, `option 7`, `#7` or `7th` refers to; None if it refers to none.

    An ordinal is accepted only if the options are numbered 1, 2, …, because the second of `0, 1, 2` is 1.
    """
    if (found := _OPTION.fullmatch(text)) is not None:
        return found[1]
    found = _ORDINAL.fullmatch(text)
    counted = bool(options) and list(options) == [str(number) for number in range(1, len(options) + 1)]
    if found is None or not counted:
        return None
    number = int(found[1])
    teen = number % 100 in {11, 12, 13}
    return found[1] if found[2].lower() == ("th" if teen else _SUFFIXES.get(number % 10, "th")) else None


_SUFFIXES = {1: "st", 2: "nd", 3: "rd"}


ZERO_ABS_TOL = 0.01
"""Absolute tolerance for keys that are 0, in the unit of the answer, because 5 % of 0 is 0.

It equals 5 % of the smallest other published key, 0.2 (scenes 93 and 99).
"""


_NOUNS = {AnswerKind.NUMBERS: "list of numbers", AnswerKind.OBJECTS: "list of objects", AnswerKind.TEXT: "text"}


@dataclass(frozen=True, slots=True)
class AnswerKey:
    """The right answer of one episode, and how answers are compared with it.

    Raises:
        ValueError: The value does not match its specification.
    """

    value: Scalar | tuple[Scalar, ...]
    spec: AnswerSpec
    objects: Mapping[str, str] = field(default_factory=dict[str, str])
    """Object id, such as `object_2` → public name."""
    steps: Mapping[str, float] = field(default_factory=dict[str, float])
    """Intermediate quantity → value. These are not part of the answer."""

    def __post_init__(self) -> None:
        listed = isinstance(self.value, tuple)
        single = self.spec.kind in {AnswerKind.NUMBER, AnswerKind.TEXT, AnswerKind.FORMULA}
        if not self.parts or (listed and single) or (not listed and self.spec.kind is AnswerKind.NUMBERS):
            raise ValueError(f"the key {self.value!r} is no {_NOUNS.get(self.spec.kind, self.spec.kind.value)}")
        for part in self.parts:
            number = plain_number(part)
            if isinstance(part, bool) or not str(part).strip() or (number is None and not isinstance(part, str)):
                raise ValueError(f"{part!r} cannot be the key of any answer")
            # A published list may contain an object id among its numbers.
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


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of comparing one part of an answer."""

    right: bool
    reason: str
    forgiven: NormalisationClass | None = None


def joined_reasons(findings: Sequence[Finding]) -> str:
    """Join the reasons of the findings, without repetition."""
    return "; ".join(dict.fromkeys(finding.reason for finding in findings))


def strict_parts(answer: JsonValue, key: AnswerKey) -> list[Item] | None:
    """Split an answer into its parts; None if it has more or fewer parts than the key."""
    if isinstance(key.value, tuple):
        items = strict_items(answer)
        return items if items is not None and len(items) == len(key.value) else None
    item = as_item(answer)
    return None if item is None else [item]


def strict_finding(item: Item, key: AnswerKey, index: int) -> Finding:
    """Compare one part of an answer strictly with its part of the key."""
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
    """Return a part of the key as a number; None if the part is not compared as a number."""
    return plain_number(key.parts[index]) if key.spec.kind in {AnswerKind.NUMBER, AnswerKind.NUMBERS} else None


def _is_numbered_object(key: AnswerKey, meant: str) -> bool:
    """Whether the key is the bare number of an object, while the prompt requests the form `object_2`."""
    return key.spec.kind is AnswerKind.OBJECTS and f"object_{meant}" in key.objects


def compare_numbers(got: Fraction, wanted: PlainNumber, key: AnswerKey) -> Finding:
    """Compare by equation 1 of the paper, on exact decimals: |got - wanted| <= abs_tol + rel_tol * |wanted|."""
    allowed = tolerance(wanted, key)
    right = abs(got - wanted.value) <= allowed
    return Finding(
        right, f"{_short(got)} is {'within' if right else 'outside'} {_short(allowed)} of {_short(wanted.value)}"
    )


def tolerance(wanted: PlainNumber, key: AnswerKey) -> Fraction:
    """Return the largest accepted distance from a part of the key, in the unit of the answer.

    If the key is 0 and the pack states no absolute tolerance, it is `ZERO_ABS_TOL`.
    """
    return allowed_distance(wanted.value, key.spec.rel_tol, key.spec.abs_tol)


def allowed_distance(wanted: Fraction, rel_tol: float, abs_tol: float) -> Fraction:
    """Return abs_tol + rel_tol * |wanted|, exactly; if `wanted` and `abs_tol` are 0, return `ZERO_ABS_TOL`."""
    floor = abs_tol or (ZERO_ABS_TOL if wanted == 0 else 0.0)
    return Fraction(repr(floor)) + Fraction(repr(rel_tol)) * abs(wanted)


def exact_text(item: Item) -> str:
    """Return the text to compare for an answer in words. A whole JSON number is written without a decimal point."""
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
    """Quote an item for use in a reason, truncated."""
    text = str(item)[:60] if isinstance(item, str) else exact_text(item)
    return f"{text!r}"
