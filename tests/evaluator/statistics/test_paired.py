"""Paired tests against published examples and against each other."""

import itertools

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.statistics.paired import PairedTest, holm, mcnemar_p, paired_difference, sign_flip_p

DARWIN = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
"""Heights of crossed over self-fertilised maize, pair by pair [1/8 inch]."""


@pytest.mark.parametrize(("only_first", "only_second", "published"), [(1, 7, 0.0703), (6, 16, 0.0525)])
def test_mcnemar_is_the_published_one(only_first: int, only_second: int, published: float) -> None:
    """Fagerland, Lydersen and Laake 2013, BMC Medical Research Methodology 13:91, exact conditional test.

    Bentur et al.: 1 and 7 children of 21 changed; 2 · (1 + 8) / 2⁸ = 0.0703. Cavo et al.: 6 and 16 patients of 161;
    2 · 110056 / 2²² = 0.0525.
    """
    assert round(mcnemar_p(only_first, only_second), 4) == published


def test_without_a_difference_there_is_nothing_to_see() -> None:
    assert mcnemar_p(0, 0) == 1.0
    assert sign_flip_p([]) == 1.0
    assert sign_flip_p([0, 0]) == 1.0


def test_sign_flips_are_the_published_ones() -> None:
    """Fisher 1935, The Design of Experiments, section 21: 863 of 32,768 sums reach 314, so 1726 / 32,768 two-sided."""
    assert sum(DARWIN) == 314
    assert sign_flip_p(DARWIN) == pytest.approx(1726 / 32768, abs=1e-12)


@settings(max_examples=50)
@given(st.lists(st.integers(min_value=-4, max_value=4), min_size=1, max_size=9))
def test_sign_flips_are_those_of_enumeration(differences: list[int]) -> None:
    signs = list(itertools.product((1, -1), repeat=len(differences)))
    sums = [abs(sum(sign * one for sign, one in zip(flips, differences, strict=True))) for flips in signs]
    assert sign_flip_p(differences) == pytest.approx(sum(one >= abs(sum(differences)) for one in sums) / len(signs))


def test_sign_flips_are_those_of_scipy() -> None:
    theirs = scipy.stats.permutation_test(
        (np.array(DARWIN[:10]), np.zeros(10)),
        lambda first, second, axis: (first - second).sum(axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=2**10,
    )
    assert sign_flip_p(DARWIN[:10]) == pytest.approx(float(theirs.pvalue), abs=1e-12)


@given(st.integers(min_value=0, max_value=60), st.integers(min_value=0, max_value=60))
def test_on_single_pairs_sign_flips_are_mcnemar(only_first: int, only_second: int) -> None:
    assert sign_flip_p([-1] * only_first + [1] * only_second) == pytest.approx(mcnemar_p(only_first, only_second))


def test_holm_is_the_published_one() -> None:
    """Example of the encyclopaedia's article on Holm's method, where the first and the last are rejected at 5 %.

    Sorted 0.005·4, 0.01·3, 0.03·2, 0.04·1 → 0.02, 0.03, 0.06, and 0.04 raised to 0.06.
    """
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


def test_a_difference_by_hand() -> None:
    pairs = [(scene, scene < 12, scene < 14) for scene in range(20)]
    pairs[0] = (0, True, False)
    found = paired_difference(pairs)
    assert (found.n, found.n_scenes, found.first_correct, found.second_correct) == (20, 20, 12, 13)
    assert (found.only_first, found.only_second, found.test) == (1, 2, PairedTest.MCNEMAR)
    assert found.difference == pytest.approx(0.05)
    assert found.p_value == 1.0  # 1 of 3: both tails
    assert found.interval is not None
    assert found.interval.low < 0.05 < found.interval.high


def test_the_pairs_of_a_scene_change_sides_together() -> None:
    # Ten scenes; in six the second is right in all of 5 seeds and the first in none, in the others both are wrong.
    pairs = [(scene, False, scene < 6) for scene in range(10) for _ in range(5)]
    found = paired_difference(pairs)
    assert (found.test, found.n, found.n_scenes) == (PairedTest.SIGN_FLIP, 50, 10)
    assert found.p_value == pytest.approx(2 / 2**6)
    # Each pair by itself would be 2 / 2³⁰.
    assert found.interval is not None
    assert (found.interval.low, found.interval.high) == pytest.approx((0.2, 0.9), abs=0.11)


def test_within_one_scene_its_pairs_are_the_sample() -> None:
    found = paired_difference([(7, seed < 2, seed < 12) for seed in range(20)])
    assert (found.test, found.n_scenes) == (PairedTest.MCNEMAR, 1)
    assert found.p_value == pytest.approx(2 / 2**10)
    assert found.interval is not None


def test_no_pairs_give_no_comparison() -> None:
    with pytest.raises(ValueError, match="at least one pair"):
        paired_difference([])


def test_two_agents_alike_are_rarely_told_apart() -> None:
    """At most 5 % of 2,000 pairs of runs of one and the same agent, with five seeds of 30 unlike scenes."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(2000):
        chances = rng.beta(0.5, 0.5, 30)
        gains = rng.binomial(5, chances) - rng.binomial(5, chances)
        alarms += sign_flip_p([int(one) for one in gains]) <= 0.05
    assert 0.02 <= alarms / 2000 <= 0.05
