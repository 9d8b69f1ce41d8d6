"""Normalised comparison: the four documented reasons to forgive a strict fail, and no fifth.

Equivalent object notation, trivial rounding, conceptual description, partial answer format. Each part of an answer
needs one of them, or to be right as it stands; they do not stack, so `3.1 N` is not also rounded.
"""

import re
from collections.abc import Sequence

from pydantic import JsonValue

from evaluator.answers.forms import (
    Item,
    Plain,
    as_item,
    free_items,
    free_number,
    is_too_long,
    plain_number,
    plain_text,
    unlabel,
    unwrap,
)
from evaluator.answers.strict import AnswerKey, Finding, compared, exact, quoted, strict_finding, told, wanted_number
from evaluator.answers.words import is_object_id, named_object
from evaluator.quantities.units import conversion, parse_unit
from evaluator.records import NormalisationClass
from scenes.pack import AnswerKind

_MAX_PATTERN_CHARS = 300
"""Longer answers are not matched against a pack's own patterns, which may be slow on long text."""
_ANSWER_LABEL = frozenset({"the", "my", "final", "answer", "result"})


def forgive(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """The finding that forgives a strict fail; None if nothing does."""
    while isinstance(answer, list) and len(answer) == 1 and not isinstance(key.value, tuple):
        answer = answer[0]
    if is_too_long(answer):
        return None
    return _forgive_form(answer, key) or _forgive_wording(answer, key)


def _forgive_form(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """Every part right in one of three forms; the first of their classes, in the documented order, stands for all."""
    findings: list[Finding] = []
    for index, item in enumerate(free_items(answer, len(key.parts)) or ()):
        finding = _free(item, key, index)
        if finding is None:
            return None
        findings.append(finding)
    if not findings:
        return None
    classes = {finding.forgiven for finding in findings}
    # Parts that are all right as they stand were missed only for the form of the whole.
    forgiven = next((one for one in NormalisationClass if one in classes), NormalisationClass.ANSWER_FORMAT)
    return Finding(right=True, reason=told(findings), forgiven=forgiven)


def _forgive_wording(answer: JsonValue, key: AnswerKey) -> Finding | None:
    """The whole answer in a wording that the scene accepts; nothing may stand before or after it."""
    item = as_item(answer)
    text = "" if item is None else str(item).strip()
    if not 0 < len(text) <= _MAX_PATTERN_CHARS:
        return None
    for pattern in key.spec.accept:
        if re.fullmatch(pattern, text, re.IGNORECASE):
            reason = f"the scene accepts this wording: {pattern}"
            return Finding(right=True, reason=reason, forgiven=NormalisationClass.CONCEPTUAL)
    return None


def _free(item: Item, key: AnswerKey, index: int) -> Finding | None:
    """What makes one part right, strictly or forgiven; None if nothing does."""
    finding = strict_finding(item, key, index)
    if finding.right:
        return finding
    wanted = wanted_number(key, index)
    if wanted is None:
        return _free_words(str(item), key, index)
    got = plain_number(item)
    return _free_quantity(item, wanted, key, index) if got is None else _rounded(got, wanted)


def _rounded(got: Plain, wanted: Plain) -> Finding | None:
    if got.significant_digits < 2 or abs(got.value - wanted.value) > got.half_unit:
        return None
    return Finding(
        right=True,
        reason=f"{wanted.text} rounded to the digits of {got.text}",
        forgiven=NormalisationClass.TRIVIAL_ROUNDING,
    )


def _free_quantity(item: Item, wanted: Plain, key: AnswerKey, index: int) -> Finding | None:
    got = free_number(item, key.spec.labels)
    if got is None or _is_mislabelled(got.label, key.spec.labels, index):
        return None
    value, converted = got.value, ""
    if got.unit is not None:
        asked = key.spec.unit[index] if isinstance(key.spec.unit, tuple) else key.spec.unit
        asked_unit = None if asked is None else parse_unit(asked)
        factor = None if asked_unit is None else conversion(got.unit, asked_unit)
        if factor is None:
            return None
        value, converted = value * factor, f", in {asked}"
    finding = compared(value, wanted, key)
    if not finding.right:
        return None
    reason = f"{quoted(item)} says one number{converted}: {finding.reason}"
    return Finding(right=True, reason=reason, forgiven=NormalisationClass.ANSWER_FORMAT)


def _is_mislabelled(label: str, labels: Sequence[str], index: int) -> bool:
    """Tell whether a part is called by the name of another part."""
    names = [name.strip().lower() for name in labels]
    return label in names and index < len(names) and names[index] != label


def _free_words(text: str, key: AnswerKey, index: int) -> Finding | None:
    """Forgive decoration around the right words (label, brackets, full stop), and other names of the right object."""
    whole = unwrap(plain_text(text))
    label, rest = unlabel(whole)
    # Only "the answer is" and its like: "object_1 = object_2" does not answer object_2.
    bare = unwrap(rest) if _ANSWER_LABEL.issuperset(label.split()) else whole
    for said in dict.fromkeys((text, bare)):
        finding = _same_words(said, key, index) or _same_object(said, key, index)
        if finding is not None:
            return finding
    return None


def _same_object(said: str, key: AnswerKey, index: int) -> Finding | None:
    meant = exact(key.parts[index])
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
    if not same_number and not strict_finding(said, key, index).right:
        return None
    return Finding(
        right=True, reason=f"{quoted(said)} is the key in another form", forgiven=NormalisationClass.ANSWER_FORMAT
    )
