"""Tests of the expected scores of a blind guess: by formula, by hand, and by playing the agent that guesses."""

import asyncio

import pytest

from evaluator.agents.baselines import GUESS_RANGE as RANGE_OF_THE_AGENT
from evaluator.agents.baselines import BlindAgent
from evaluator.answers.grading import grade
from evaluator.answers.rewards import GUESS_RANGE, Chance, blind_chance, chance_at
from evaluator.answers.strict import AnswerKey
from evaluator.episode.player import Briefing
from evaluator.records.episode import Verdict
from scenes.answer_spec import AnswerKind, AnswerSpec
from tests.builders.records import episode_key

PAIR = AnswerSpec(kind=AnswerKind.NUMBERS, labels=("a", "b"), abs_tol=3.0)
KEYS = {
    "choice": AnswerKey("left", AnswerSpec(kind=AnswerKind.CHOICE, options=("left", "right", "stays"))),
    "number": AnswerKey(3.0, AnswerSpec(kind=AnswerKind.NUMBER, rel_tol=0.5)),
    "edge": AnswerKey(90.0, AnswerSpec(kind=AnswerKind.NUMBER, rel_tol=0.5)),
    "numbers": AnswerKey((2.0, 5.0), PAIR),
}


def test_both_guess_in_the_same_range() -> None:
    assert GUESS_RANGE == RANGE_OF_THE_AGENT


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        (KEYS["choice"], (1 / 3, 1 / 3)),
        # ln(1.05 / 0.95) / ln(10⁴), for a key of any size.
        (AnswerKey(3.0, AnswerSpec(kind=AnswerKind.NUMBER)), (0.010866, 0.010866)),
        (AnswerKey(-3.0, AnswerSpec(kind=AnswerKind.NUMBER)), (0, 0)),
        (AnswerKey(5000.0, AnswerSpec(kind=AnswerKind.NUMBER)), (0, 0)),
        (AnswerKey(0.0, AnswerSpec(kind=AnswerKind.NUMBER, abs_tol=0.1)), (0.25, 0.25)),
        (AnswerKey("m*g", AnswerSpec(kind=AnswerKind.TEXT)), (0, 0)),
        (AnswerKey((1.0, 2.0), AnswerSpec(kind=AnswerKind.NUMBERS)), (0, 0)),
    ],
)
def test_by_hand(key: AnswerKey, expected: tuple[float, float]) -> None:
    assert blind_chance(key) == pytest.approx(expected, abs=1e-6)


def test_two_numbers_are_guessed_apart() -> None:
    strict, graded = blind_chance(KEYS["numbers"])
    shares = [
        blind_chance(AnswerKey(value, AnswerSpec(kind=AnswerKind.NUMBER, abs_tol=3.0))).strict for value in (2, 5)
    ]
    assert (strict, graded) == pytest.approx((shares[0] * shares[1], sum(shares) / 2))


@pytest.mark.parametrize("name", KEYS)
def test_the_blind_agent_is_right_as_often(name: str) -> None:
    key, count = KEYS[name], 4000
    form = {"kind": key.spec.kind.value, "options": list(key.spec.options), "labels": list(key.spec.labels)}
    briefing = Briefing(prompt="", scene={"answer": form}, tools=(), budget=20)
    right, graded = 0, 0.0
    for seed in range(count):
        reply = asyncio.run(BlindAgent().player(episode_key(seed=seed), briefing).act(None))
        found = grade(reply.calls[0].arguments["answer"], key)
        right += found.strict is Verdict.CORRECT
        graded += found.graded or 0.0
    # Four standard errors.
    assert (right / count, graded / count) == pytest.approx(blind_chance(key), abs=4 * 0.5 / count**0.5)


def test_a_withheld_key_and_one_of_another_form_leave_the_key_of_the_scene() -> None:
    form = KEYS["number"]
    assert chance_at(form, None) == chance_at(form, [1, 2]) == blind_chance(form)
    assert chance_at(form, -3.0) == Chance(0, 0)
