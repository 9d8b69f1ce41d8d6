"""Tests of the ability in an adaptive test: likelihoods by quadrature, and information by its formula."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from evaluator.records.episode import Choice
from evaluator.statistics.ability import (
    SceneDifficulty,
    ability_of,
    information,
    posterior_ability,
    scene_likelihood,
)

MIDDLE = 80
"""Index of ability 0 in the grid, whose step is 0.15 logits."""


def chance(logits: float) -> float:
    return 1 / (1 + math.exp(-logits))


def test_the_likelihood_of_two_variants_integrates_over_the_scene_and_both_variants() -> None:
    found = scene_likelihood(SceneDifficulty(0.5, 0.4, 0.6), {0: (1, 1), 1: (1, 3)})
    at, weights = np.polynomial.hermite_e.hermegauss(60)
    weights = weights / weights.sum()
    for place, ability in ((MIDDLE, 0.0), (MIDDLE + 8, 1.2)):
        p = 1 / (1 + np.exp(-(ability - 0.5 - 0.4 * at[:, None] - 0.6 * at)))
        direct = weights @ ((p @ weights) * ((p * (1 - p) ** 2) @ weights))
        assert found[place] == pytest.approx(math.log(direct), abs=1e-3)


def test_a_single_variant_is_as_unknown_as_scene_and_variant_together() -> None:
    found = scene_likelihood(SceneDifficulty(0.5, 0.4, 0.6), {3: (1, 1)})[MIDDLE]
    direct = quad(lambda z: norm.pdf(z) * chance(-0.5 - math.hypot(0.4, 0.6) * z), -8, 8)[0]
    assert found == pytest.approx(math.log(direct), abs=1e-4)


def test_without_answers_the_ability_is_the_prior_and_right_answers_raise_it() -> None:
    prior = posterior_ability([], 0)
    assert (prior.ability, prior.answers) == (pytest.approx(0.0, abs=1e-9), 0)
    assert prior.se == pytest.approx(3.0, rel=0.03)
    choice = Choice(ability=0, se=3, information=0.2, rank=1, difficulty=1.0, difficulty_se=0.3, variant_sd=0.5)
    right, wrong = (ability_of([(7, 0, choice, is_right), (8, 0, choice, True)]) for is_right in (True, False))
    assert right.ability > wrong.ability
    assert right.answers == 2
    assert wrong.interval.low < wrong.ability < wrong.interval.high


def test_information_is_greatest_where_the_chance_is_even_and_less_for_each_further_answer_in_a_scene() -> None:
    exact = [SceneDifficulty(place, 0.0, 0.0) for place in (-2.0, 0.0, 1.0)]
    p = np.array([chance(1.0 - one.logits) for one in exact])
    assert information(exact, [0, 3, 0], 1.0) == pytest.approx(p * (1 - p))
    unsure = [SceneDifficulty(0.0, 0.5, 0.0)] * 3
    first, second, tenth = information(unsure, [0, 1, 9], 0.0)
    assert first == pytest.approx(0.25 / (1 + 0.25 * 0.25))
    assert first > second > tenth
    # Even many answers in one scene cannot determine the ability better than the scene's difficulty is known.
    assert information([SceneDifficulty(0.0, 0.5, 0.0)] * 500, range(500), 0.0).sum() == pytest.approx(4.0, rel=0.05)
