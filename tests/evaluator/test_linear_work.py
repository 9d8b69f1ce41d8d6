"""Work on what an agent wrote is in proportion to its length, so that no text can hold the evaluator up.

The work is counted and not timed: calls of functions, and steps of the regular expressions that run within one call.
A text that is twice as long makes twice the work; the square of the length would make four times. `make bench` prints
what it takes in time.
"""

import re
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.answers import forms, words
from evaluator.answers.forms import MAX_CHARS
from evaluator.answers.grading import grade
from evaluator.answers.strict import AnswerKey
from evaluator.failures import answering, calling, findings, reasoning
from evaluator.failures.detect import failures_of
from evaluator.failures.findings import expected_form
from evaluator.protocols import lenient_json, text
from evaluator.protocols.text import parse_reply
from evaluator.quantities import formulas, spoken
from evaluator.scores import dimensions
from evaluator.scores.grounding import grounding_of
from scenes.answer_spec import AnswerKind, AnswerSpec
from tests.builders.counting import calls_made
from tests.builders.pattern_steps import match_steps, search_steps
from tests.builders.records import RIGHT, episode, returned, turn

MOST = 2.5
"""Bound on the growth of the work when a text becomes twice as long: 2 and some room for what each text costs."""
ANSWERS = [
    *("1", " ", "(", "[", "{", "-", "1 ", "a ", "1,", "\\frac{", "^{", "a=", "1/", "[1,", "is ", "_", "\\", "m/", "\n"),
]
PROSE = [
    *("1", "1 ", "(1,", "1.", "-", "1e", "1 m ", "[1,2]", "{", " ", "1 m/s/s*", "cart (object_2), ", "the name 1"),
    *("object_1 (wall) ", "match ", "period 1", "expected ", "assume ", "given the ", "x"),
    *("=1", "2*3=6 ", "2*3=", "x=2*", "√(", "\\frac{", "a ", "should ", "T = ", "real ", "mass ", "0.37*2=0.74 "),
]
REPLIES = [
    '[{"tool":"a"},',
    '{"a": /* }',
    '{"tool": \\"',
    "[{",
    "{'",
    "1",
    '{"tool":"x"} ',
    "```json {'tool':x} ```",
    '[{"tool":"a","parameters":{}}',
    '\\"',
    '{"a":[',
    '[{"tool": 1/3}]\n',
    "[{'a",
    "<|tool_call_begin|>",
    '{"a":"\n',
    "[ ",
]
KEYS = [
    AnswerKey(2.5, AnswerSpec(kind=AnswerKind.NUMBER, unit="m")),
    AnswerKey((2.5, 3.5), AnswerSpec(kind=AnswerKind.NUMBERS, unit="m", labels=("a", "b"))),
    AnswerKey("object_1", AnswerSpec(kind=AnswerKind.OBJECTS), {"object_1": "cart", "object_2": "wall"}),
    AnswerKey("rises", AnswerSpec(kind=AnswerKind.CHOICE, options=("rises", "falls"))),
    AnswerKey("it tips", AnswerSpec(kind=AnswerKind.TEXT, accept=("it (?:tips|falls) over",))),
]
MATCHED = {"_LABEL", "_TWO_NAMES", "_NUMBERS", "_MORE", "_CLOSING", "_SCAN"}
"""Patterns that are matched at one place. All others are searched for in the whole text."""
Steps = Callable[[re.Pattern[str], str], int]


def growth(work: Callable[[str], int], piece: str, length: int) -> float:
    """By what factor the work grows when a text that repeats a piece becomes twice as long."""
    once, twice = ((piece * (size // len(piece) + 1))[:size] for size in (length, 2 * length))
    work(once)  # fills caches
    return work(twice) / work(once)


def steps_of_search(pattern: re.Pattern[str], written: str) -> int:
    return search_steps(pattern, written)[0]


def patterns_within(name: str, value: object) -> Iterator[tuple[str, re.Pattern[str]]]:
    if isinstance(value, re.Pattern):
        yield name, value
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
    for number, part in enumerate(parts):
        yield from patterns_within(f"{name} {number}", part)


PATTERNS = [
    pytest.param(pattern, match_steps if name in MATCHED else steps_of_search, pieces, id=f"{module.__name__}.{place}")
    for pieces, modules in (
        (ANSWERS, (forms, words)),
        (PROSE, (spoken, formulas, dimensions, answering, calling, findings, reasoning)),
        (REPLIES, (lenient_json, text)),
    )
    for module in modules
    for name, value in vars(module).items()
    for place, pattern in patterns_within(name, value)
]
"""Each regular expression of the modules that read what an agent wrote."""


@pytest.mark.parametrize(("pattern", "steps", "pieces"), PATTERNS)
def test_the_steps_of_a_pattern_grow_no_faster_than_the_text(
    pattern: re.Pattern[str], steps: Steps, pieces: list[str]
) -> None:
    found = {piece: growth(lambda written: steps(pattern, written), piece, 60) for piece in pieces}
    assert {piece: factor for piece, factor in found.items() if factor > MOST} == {}


@pytest.mark.parametrize("piece", ANSWERS)
def test_the_work_of_grading_grows_no_faster_than_the_answer(piece: str) -> None:
    for key in KEYS:
        assert growth(lambda answer, key=key: calls_made(lambda: grade(answer, key)), piece, MAX_CHARS // 2) < MOST


@pytest.mark.parametrize("piece", PROSE)
def test_the_work_of_scoring_grows_no_faster_than_the_reasoning(piece: str) -> None:
    many = returned("get_velocity", {"velocity": [float(number) + 0.37 for number in range(20)]})
    form = expected_form(KEYS[0])

    def work(said: str) -> int:
        played = episode(turn("", many), turn(said, returned("answer", answer=1)))
        return calls_made(lambda: (grounding_of(played), failures_of(played, RIGHT, form)))

    assert growth(work, piece, 300) < MOST


@pytest.mark.parametrize("piece", REPLIES)
def test_the_work_of_reading_a_reply_grows_no_faster_than_its_length(piece: str) -> None:
    assert growth(lambda written: calls_made(lambda: parse_reply(written + "x")), piece, 5000) < MOST


@pytest.mark.parametrize(
    ("pattern", "piece"), [(r"\s+x", " "), (r"(?:a|ab)*c", "ab"), (r"\w+@", "a"), (r"(?:a*)*b", "a")]
)
def test_a_pattern_that_can_be_held_up_is_noticed(pattern: str, piece: str) -> None:
    assert growth(lambda written: steps_of_search(re.compile(pattern), written), piece, 6) > MOST


@given(
    pattern=st.sampled_from([one.values[0] for one in PATTERNS]),
    written=st.text(st.sampled_from("a1 (),.=[]{}\"'\\/-+e_\n"), max_size=12),
)
def test_steps_are_those_of_a_search_that_finds_what_re_finds(pattern: re.Pattern[str], written: str) -> None:
    assert search_steps(pattern, written)[1] == [found.span() for found in pattern.finditer(written)]
