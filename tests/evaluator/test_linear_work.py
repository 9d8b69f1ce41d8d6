"""Tests that the work on an agent's text is linear in its length, so that no text can block the evaluator.

Work is counted in function calls instead of timed. A text of twice the length must take twice the work; quadratic work
would take four times. Searches by regular expressions count as one call each; `make bench` times the same texts.
"""

from collections.abc import Callable

import pytest

from evaluator.answers.forms import MAX_CHARS
from evaluator.answers.grading import grade
from evaluator.answers.strict import AnswerKey
from evaluator.episode.protocols.text import parse_reply
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import expected_form
from evaluator.scores.grounding import grounding_of
from scenes.answer_spec import AnswerKind, AnswerSpec
from tests.builders.counting import calls_made
from tests.builders.records import RIGHT, episode, returned, turn

MOST = 2.5
"""Bound on the growth of the work when a text becomes twice as long: 2, and a margin for the fixed work per text."""
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


def growth(work: Callable[[str], int], piece: str, length: int) -> float:
    """Return the factor by which the work grows when a text that repeats a piece becomes twice as long."""
    once, twice = ((piece * (size // len(piece) + 1))[:size] for size in (length, 2 * length))
    work(once)  # fills caches
    return work(twice) / work(once)


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
