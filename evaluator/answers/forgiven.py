"""Normalised grading: accepts a strictly wrong answer for one of four documented reasons.

The reasons are equivalent object notation, trivial rounding, conceptual description and partial answer format. Each
part of the answer must be strictly right or have exactly one reason. Reasons are not combined: a number
with a unit, such as `3.1 N`, is not also accepted as rounded.
"""

import re
from collections.abc import Sequence
from fractions import Fraction

from pydantic import JsonValue

from evaluator.answers.forms import (
    Item,
    PlainNumber,
    as_item,
    is_too_long,
    labelled_items,
    lenient_items,
    lenient_number,
    plain_number,
    plain_text,
    unlabel,
    unwrap,
)
from evaluator.answers.formula import compare_formulas, one_side
from evaluator.answers.strict import (
    AnswerKey,
    Finding,
    compare_numbers,
    exact_text,
    is_object_id,
    joined_reasons,
    named_object,
    named_option,
    quoted,
    strict_finding,
    wanted_number,
)
from evaluator.quantities.units import conversion, parse_unit, same_quantity
from evaluator.records.episode import NormalisationClass
from scenes import AnswerKind

_MAX_PATTERN_CHARS = 300
"""Longest answer that is matched against a pack's patterns, because matching long text may be slow."""
_MOST_ROUNDED = Fraction(1, 10)
"""Largest relative error accepted as trivial rounding: twice the tolerance of the paper."""
_ANSWER_LABEL = frozenset({"the", "my", "final", "answer", "result"})


def forgive(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """Return the finding that accepts a strictly wrong answer; None if no reason applies."""
    listed = isinstance(key.value, tuple)
    while isinstance(answer, list) and len(answer) == 1 and (not listed or isinstance(answer[0], list)):
        answer = answer[0]
    if is_too_long(answer):
        return None
    return _forgive_form(answer, key) or _forgive_wording(answer, key)


def _forgive_form(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """Accept an answer if every part is right, strictly or by normalisation.

    If parts need different classes of normalisation, the grade names the one that is first in `NormalisationClass`.
    """
    findings: list[Finding] = []
    items = labelled_items(answer, key.spec.labels) or lenient_items(answer, len(key.parts)) or ()
    for index, item in enumerate(items):
        finding = _right_part(item, key, index)
        if finding is None:
            return None
        findings.append(finding)
    if not findings:
        return None
    classes = {finding.forgiven for finding in findings}
    # If every part is strictly right, only the form of the whole answer was wrong.
    forgiven = next((reason for reason in NormalisationClass if reason in classes), NormalisationClass.ANSWER_FORMAT)
    return Finding(right=True, reason=joined_reasons(findings), forgiven=forgiven)


def _forgive_wording(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """Accept a wording that the scene lists. The pattern must match the whole answer."""
    item = as_item(answer)
    text = "" if item is None else str(item).strip()
    if not 0 < len(text) <= _MAX_PATTERN_CHARS:
        return None
    for pattern in key.spec.accept:
        if re.fullmatch(pattern, text, re.IGNORECASE):
            reason = f"the scene accepts this wording: {pattern}"
            return Finding(right=True, reason=reason, forgiven=NormalisationClass.CONCEPTUAL)
    return None


def _right_part(item: Item, key: AnswerKey, index: int) -> Finding | None:
    """Explain why one part is right, strictly or by normalisation; None if it is wrong."""
    finding = strict_finding(item, key, index)
    if finding.right:
        return finding
    if key.spec.kind is AnswerKind.FORMULA:
        return _forgive_formula(str(item), key)
    wanted = wanted_number(key, index)
    if wanted is None:
        return _forgive_words(str(item), key, index)
    got = plain_number(item)
    return _forgive_quantity(item, wanted, key, index) if got is None else _forgive_rounding(got, wanted)


def _forgive_rounding(got: PlainNumber, wanted: PlainNumber) -> Finding | None:
    """Accept the key rounded to the digits that the answer shows, with an error of at most 10 %.

    The number needs a decimal point or two significant digits, so that a guessed small whole number is not accepted.
    """
    is_rounded = got.significant_digits > 1 or "." in got.text
    allowed = min(got.half_unit, _MOST_ROUNDED * abs(wanted.value))
    if not is_rounded or abs(got.value - wanted.value) > allowed:
        return None
    return Finding(
        right=True,
        reason=f"{wanted.text} rounded to the digits of {got.text}",
        forgiven=NormalisationClass.TRIVIAL_ROUNDING,
    )


def _forgive_quantity(item: Item, wanted: PlainNumber, key: AnswerKey, index: int) -> Finding | None:
    got = lenient_number(item, key.spec.labels)
    if got is None or _is_mislabelled(got.label, key.spec.labels, index):
        return None
    value, converted = got.value, ""
    if got.unit is not None:
        asked = key.spec.unit[index] if isinstance(key.spec.unit, tuple) else key.spec.unit
        asked_unit = None if asked is None else parse_unit(asked)
        factor = None if asked_unit is None else conversion(got.unit, asked_unit)
        if asked_unit is None or factor is None or not same_quantity(got.unit, asked_unit):
            return None
        value, converted = value * factor, f", in {asked}"
    finding = compare_numbers(value, wanted, key)
    if not finding.right:
        return None
    reason = f"{quoted(item)} says one number{converted}: {finding.reason}"
    return Finding(right=True, reason=reason, forgiven=NormalisationClass.ANSWER_FORMAT)


def _forgive_formula(text: str, key: AnswerKey) -> Finding | None:
    """Accept a formula with a left side as in `F = 2 x`, a label, LaTeX, or variables without a space between them."""
    right, reason = compare_formulas(one_side(text, key.spec.variables), str(key.value), key.spec, run_together=True)
    return Finding(right=True, reason=reason, forgiven=NormalisationClass.ANSWER_FORMAT) if right else None


def _is_mislabelled(label: str, labels: Sequence[str], index: int) -> bool:
    """Whether a part has the label of another part."""
    names = [name.strip().lower() for name in labels]
    return label in names and index < len(names) and names[index] != label


def _forgive_words(text: str, key: AnswerKey, index: int) -> Finding | None:
    """Accept the right words with a label, brackets or a full stop, and the right object in another notation."""
    whole = unwrap(plain_text(text))
    label, rest = unlabel(whole)
    # Drop only labels such as "the answer is": `object_1 = object_2` does not answer object_2.
    bare = unwrap(rest) if _ANSWER_LABEL.issuperset(label.split()) else whole
    for said in dict.fromkeys((text, bare)):
        finding = _same_words(said, key, index) or _same_object(said, key, index)
        if finding is not None:
            return finding
    return None


def _same_object(said: str, key: AnswerKey, index: int) -> Finding | None:
    meant = exact_text(key.parts[index])
    by_number = not key.spec.options or any(is_object_id(option.strip().lower()) for option in key.spec.options)
    if key.spec.kind is AnswerKind.TEXT or (key.spec.kind is not AnswerKind.OBJECTS and not by_number):
        return None
    objects = key.objects or {meant if is_object_id(meant) else f"object_{meant}": ""}
    named = named_object(said, objects)
    if named is None or named != named_object(meant, objects):
        return None
    return Finding(
        right=True, reason=f"{quoted(said)} is another name of {named}", forgiven=NormalisationClass.OBJECT_NOTATION
    )


def _same_words(said: str, key: AnswerKey, index: int) -> Finding | None:
    got, wanted = plain_number(said), plain_number(key.parts[index])
    same_number = got is not None and wanted is not None and got.value == wanted.value
    same_option = key.spec.kind is AnswerKind.CHOICE and named_option(said, key.spec.options) == exact_text(
        key.parts[index]
    )
    if not same_number and not same_option and not strict_finding(said, key, index).right:
        return None
    return Finding(
        right=True, reason=f"{quoted(said)} is the key in another form", forgiven=NormalisationClass.ANSWER_FORMAT
    )
