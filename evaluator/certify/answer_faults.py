"""Finds faults of what a pack asks for: the key, the form of the answer, and the units that the task names."""

import re
from collections.abc import Iterable, Iterator

from evaluator.answers.strict import AnswerKey
from evaluator.quantities.units import Unit, parse_unit
from scenes import AnswerKind, AnswerSpec, Pack

_SENTENCE_END = re.compile(r"(?<=[.?!])\s+(?=[A-Z(])")
_UNIT = r"in (?P<unit>[A-Za-zµ°%][\wµ°%·^*/⁻¹²³]*(?: per [a-z]+)*)"
_IN_QUESTION = re.compile(rf"[,(] ?{_UNIT}")
"""In a question a unit stands apart, as in `how fast is it, in m/s, after 2 s?`, unlike `with t in seconds`."""
_IN_INSTRUCTION = re.compile(rf"\b{_UNIT}")
"""Anywhere in a sentence that tells how to answer, as in `Answer both in N.`"""
_NUMERIC = {AnswerKind.NUMBER, AnswerKind.NUMBERS}


def answer_faults(pack: Pack) -> Iterator[str]:
    """The faults of a pack's key and answer form, one sentence for each, with its remedy."""
    spec = pack.answer_spec
    if spec is None:
        return
    try:
        AnswerKey(pack.answer, spec)
    except ValueError as error:
        yield f"answer: no answer can be compared with the key: {error}"
    if spec.kind is AnswerKind.TEXT:
        yield "answer_spec.kind is text, but free words cannot be graded reliably: make it a choice with options"
    if spec.kind in {AnswerKind.CHOICE, AnswerKind.OBJECTS} and not spec.options:
        yield "answer_spec.options is empty: an agent must see what it can choose from"
    if any("," in option for option in spec.options):
        yield "answer_spec.options: the prompt lists options with commas between them, so none may have a comma"
    if spec.options and str(pack.answer) not in spec.options:
        yield f"the answer {pack.answer!r} is not among the options {list(spec.options)}"
    if spec.kind is AnswerKind.FORMULA and not spec.variables:
        yield "answer_spec.variables is empty: a formula needs the variables that it may use"
    yield from _form_of_numbers(spec)
    yield from _units(pack.metadata.task, spec)


def _form_of_numbers(spec: AnswerSpec) -> Iterator[str]:
    if spec.kind in _NUMERIC and spec.unit is None:
        yield 'answer_spec.unit is missing; write "1" for a pure number'
    if spec.kind is not AnswerKind.NUMBERS:
        return
    if not spec.labels:
        yield "answer_spec.labels is empty: an agent must see what each number is, and their order"
    if isinstance(spec.unit, str):
        yield f"answer_spec.unit is {spec.unit!r}: list one unit for each label"


def _units(task: str, spec: AnswerSpec) -> Iterator[str]:
    """Report units that cannot be read, and units of the answer that differ from those of the question."""
    written = (spec.unit,) if isinstance(spec.unit, str) else spec.unit or ()
    unread = [unit for unit in written if parse_unit(unit) is None]
    if unread:
        yield f"answer_spec.unit: {unread[0]!r} is no unit that can be read, so every answer with a unit would fail"
        return
    wanted = [unit for unit in dict.fromkeys(written) if parse_unit(unit) != parse_unit("1")]
    asked = _asked_units(task)
    if wanted and not asked:
        yield f"the task's question names no unit, but answer_spec.unit says {', '.join(wanted)}: name it there too"
    elif _read(asked) != _read(wanted):
        yield (
            f"the task's question asks for {', '.join(asked)}, but answer_spec.unit says"
            f" {', '.join(wanted) or 'nothing'}: name the same units in the same order"
        )


def _asked_units(task: str) -> list[str]:
    """The units that the questions and the instructions of a task name, in the order of their first mention."""
    named: list[str] = []
    for sentence in _SENTENCE_END.split(task):
        is_instruction = sentence.startswith(("Answer", "Give"))
        if is_instruction or sentence.endswith("?"):
            pattern = _IN_INSTRUCTION if is_instruction else _IN_QUESTION
            named += [found["unit"] for found in pattern.finditer(sentence)]
    return [unit for unit in dict.fromkeys(named) if parse_unit(unit) is not None]


def _read(units: Iterable[str]) -> list[Unit | None]:
    """The units without repetition; `degree` and `degrees` are one."""
    return list(dict.fromkeys(map(parse_unit, units)))
