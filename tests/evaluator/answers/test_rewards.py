"""Tests of rewards: strict, graded, by parts, corrected for guessing, and reduced by costs."""

import math
import random
from typing import Any

import numpy as np
import pytest

import evaluator
from evaluator.answers.grading import grade
from evaluator.answers.rewards import GUESS_RANGE, RewardRule, Worth, answer_reward, chance_of_form
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Verdict
from scenes.answer_spec import AnswerKind, AnswerSpec

NUMBER = AnswerKey(2.0, AnswerSpec(kind=AnswerKind.NUMBER))
PAIR = AnswerKey((2.0, 5.0), AnswerSpec(kind=AnswerKind.NUMBERS, labels=("first", "second")))
CHOICE = AnswerKey("b", AnswerSpec(kind=AnswerKind.CHOICE, options=("a", "b", "c", "d")))


@pytest.mark.parametrize(
    ("answer", "key", "strict", "graded", "parts"),
    [
        (2.05, NUMBER, 1, 1, (True,)),
        (2.2, NUMBER, 0, 0, (False,)),
        ("2.0 m", NUMBER, 0, 0, (False,)),
        ([2.0, 5.0], PAIR, 1, 1, (True, True)),
        ([2.0, 9.0], PAIR, 0, 0.5, (True, False)),
        ([2.0], PAIR, 0, 0, (False, False)),
        (2.0, PAIR, 0, 0, (False, False)),
        (None, PAIR, 0, 0, (False, False)),
        ("2" * 10_000, PAIR, 0, 0, (False, False)),
        ("b", CHOICE, 1, 1, (True,)),
        ("a", CHOICE, 0, 0, (False,)),
    ],
)
def test_an_answer_is_worth_its_parts(
    answer: object, key: AnswerKey, strict: float, graded: float, parts: tuple[bool, ...]
) -> None:
    found = answer_reward(answer, key)  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    assert (found.strict, found.graded, found.parts) == (strict, graded, parts)
    graded_as = grade(answer, key)  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    assert (found.graded, found.strict) == (graded_as.graded, graded_as.strict is Verdict.CORRECT)


def test_guesses_among_options_earn_nothing_on_average() -> None:
    rewards = [answer_reward(option, CHOICE) for option in CHOICE.spec.options]
    assert [found.chance for found in rewards] == [0.25] * 4
    assert math.fsum(found.chance_corrected for found in rewards) == pytest.approx(0)
    assert max(found.chance_corrected for found in rewards) == 1


def test_guessed_numbers_earn_nothing_on_average() -> None:
    """Guesses 20,000 times, log-uniformly as the agent `blind` does; the mean may differ by four standard errors."""
    chooser, (low, high) = random.Random(5), GUESS_RANGE
    guesses = [math.exp(chooser.uniform(math.log(low), math.log(high))) for _ in range(20_000)]
    rewards = [answer_reward(guess, NUMBER).chance_corrected for guess in guesses]
    mean = math.fsum(rewards) / len(rewards)
    spread = math.sqrt(math.fsum((found - mean) ** 2 for found in rewards) / len(rewards))
    assert abs(mean) < 4 * spread / math.sqrt(len(rewards))


@pytest.mark.parametrize(
    ("kind", "facts", "chance"),
    [
        (AnswerKind.CHOICE, {"options": ("a", "b")}, 0.5),
        (AnswerKind.NUMBER, {}, 0.010867),
        (AnswerKind.NUMBER, {"rel_tol": 0.02}, 0.004344),
        (AnswerKind.NUMBER, {"rel_tol": 1.5}, 1),
        (AnswerKind.NUMBERS, {"labels": ("first", "second")}, 0.010867**2),
        (AnswerKind.NUMBERS, {}, 0),
        (AnswerKind.OBJECTS, {}, 0),
    ],
)
def test_the_chance_follows_from_the_form_of_the_answer(kind: AnswerKind, facts: dict[str, Any], chance: float) -> None:
    assert chance_of_form(AnswerSpec(kind=kind, **facts)) == pytest.approx(chance, rel=1e-3)


def test_a_task_that_a_guess_always_solves_is_not_corrected() -> None:
    certain = AnswerKey("a", AnswerSpec(kind=AnswerKind.CHOICE, options=("a",)))
    assert answer_reward("a", certain).chance == 1
    assert answer_reward("a", certain).chance_corrected == 1
    assert answer_reward("b", certain).chance_corrected == 0


@pytest.mark.parametrize(("worth", "expected"), [(Worth.STRICT, 0.0), (Worth.GRADED, 0.5)])
def test_a_rule_names_the_number_that_counts_and_takes_off_the_cost(worth: Worth, expected: float) -> None:
    half = answer_reward([2.0, 9.0], PAIR)
    assert RewardRule(worth).reward(half, 9, 9) == expected
    assert RewardRule(worth, per_iteration=0.125, per_call=0.25).reward(half, 2, 4) == expected - 1.25


def test_the_chance_corrected_rule_is_below_zero_for_a_wrong_choice() -> None:
    assert RewardRule(Worth.CHANCE_CORRECTED).reward(answer_reward("a", CHOICE), 0, 0) == pytest.approx(-1 / 3)


def test_the_public_reward_knows_the_key_of_every_variant() -> None:
    assert evaluator.reward(7, 0, 7.848).strict == 1
    assert evaluator.reward(7, 3, 7.848).strict == 0  # another gravity
    assert evaluator.reward(7, 3, 0.8 * 6.33964).parts == (True,)
    assert evaluator.reward(7, 3, None).strict == 0
    seed_of_numpy: Any = np.int64(3)
    assert evaluator.reward(7, seed_of_numpy, 0.8 * 6.33964).strict == 1


def test_the_public_reward_refuses_a_scene_that_is_not_there() -> None:
    with pytest.raises(evaluator.UsageError, match="9999"):
        evaluator.reward(9999, 0, 1.0)


@pytest.mark.parametrize("seed", [-1, 1.5, None, True, "0"])
def test_a_seed_that_no_server_opens_has_no_reward(seed: Any) -> None:
    with pytest.raises(evaluator.UsageError, match="the seed must be an integer from 0 on"):
        evaluator.reward(7, seed, 7.848)
