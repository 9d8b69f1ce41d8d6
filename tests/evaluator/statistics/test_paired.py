"""Tests of the statistical tests of paired runs, against published examples and each other."""

import itertools

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.statistics.paired import PairedTest, holm, mcnemar_p, paired_difference, sign_flip_p

DARWIN = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
"""Height differences of cross- and self-fertilised maize, pair by pair [1/8 inch]."""


@pytest.mark.parametrize(("only_first", "only_second", "published"), [(1, 7, 0.0703), (6, 16, 0.0525)])
def test_mcnemar_matches_published_examples(only_first: int, only_second: int, published: float) -> None:
    """Fagerland, Lydersen and Laake 2013, BMC Medical Research Methodology 13:91, exact conditional test.

    Bentur et al.: 1 and 7 children of 21 changed; 2 · (1 + 8) / 2⁸ = 0.0703. Cavo et al.: 6 and 16 patients of 161;
    2 · 110056 / 2²² = 0.0525.
    """
    assert round(mcnemar_p(only_first, only_second), 4) == published


def test_without_a_difference_the_p_value_is_1() -> None:
    assert mcnemar_p(0, 0) == 1.0
    assert sign_flip_p([]) == 1.0
    assert sign_flip_p([0, 0]) == 1.0


def test_sign_flips_match_the_published_example() -> None:
    """Fisher 1935, The Design of Experiments, section 21: 863 of 32,768 sums reach 314, so 1726 / 32,768 two-sided."""
    assert sum(DARWIN) == 314
    assert sign_flip_p(DARWIN) == pytest.approx(1726 / 32768, abs=1e-12)


@settings(max_examples=50)
@given(st.lists(st.integers(min_value=-4, max_value=4), min_size=1, max_size=9))
def test_sign_flips_match_a_full_enumeration(differences: list[int]) -> None:
    signs = list(itertools.product((1, -1), repeat=len(differences)))
    sums = [abs(sum(sign * gain for sign, gain in zip(flips, differences, strict=True))) for flips in signs]
    assert sign_flip_p(differences) == pytest.approx(sum(total >= abs(sum(differences)) for total in sums) / len(signs))


def test_sign_flips_match_scipy() -> None:
    theirs = scipy.stats.permutation_test(
        (np.array(DARWIN[:10]), np.zeros(10)),
        lambda first, second, axis: (first - second).sum(axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=2**10,
    )
    assert sign_flip_p(DARWIN[:10]) == pytest.approx(float(theirs.pvalue), abs=1e-12)


@given(st.integers(min_value=0, max_value=60), st.integers(min_value=0, max_value=60))
def test_sign_flips_of_single_pairs_equal_mcnemar(only_first: int, only_second: int) -> None:
    assert sign_flip_p([-1] * only_first + [1] * only_second) == pytest.approx(mcnemar_p(only_first, only_second))


def test_holm_matches_the_published_example() -> None:
    """Example from the Wikipedia article on Holm's method; the first and the last are rejected at 5 %.

    Sorted: 0.005·4, 0.01·3, 0.03·2, 0.04·1 → 0.02, 0.03, 0.06, and 0.04 is raised to 0.06.
    """
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


def test_a_paired_difference_matches_a_manual_calculation() -> None:
    pairs = [(scene, scene < 12, scene < 14) for scene in range(20)]
    pairs[0] = (0, True, False)
    found = paired_difference(pairs)
    assert (found.n, found.n_scenes, found.first_correct, found.second_correct) == (20, 20, 12, 13)
    assert (found.only_first, found.only_second, found.test) == (1, 2, PairedTest.MCNEMAR)
    assert found.difference == pytest.approx(0.05)
    assert found.p_value == 1.0  # 1 of 3, two-sided
    assert found.interval is not None
    assert found.interval.low < 0.05 < found.interval.high


def test_the_pairs_of_a_scene_are_flipped_together() -> None:
    # In six of ten scenes the second is right on all 5 seeds and the first on none; in the others both are wrong.
    pairs = [(scene, False, scene < 6) for scene in range(10) for _ in range(5)]
    found = paired_difference(pairs)
    assert (found.test, found.n, found.n_scenes) == (PairedTest.SIGN_FLIP, 50, 10)
    assert found.p_value == pytest.approx(2 / 2**6)
    # Independent pairs would give p = 2 / 2³⁰.
    assert found.interval is not None
    assert (found.interval.low, found.interval.high) == pytest.approx((0.2, 0.9), abs=0.11)


def test_with_a_single_scene_its_pairs_are_the_sample() -> None:
    found = paired_difference([(7, seed < 2, seed < 12) for seed in range(20)])
    assert (found.test, found.n_scenes) == (PairedTest.MCNEMAR, 1)
    assert found.p_value == pytest.approx(2 / 2**10)
    assert found.interval is not None


def test_a_comparison_without_pairs_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one pair"):
        paired_difference([])


def test_equal_agents_differ_significantly_in_at_most_5_per_cent_of_runs() -> None:
    """Simulates 2,000 pairs of runs of the same agent, on five seeds of 30 scenes of different difficulty."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(2000):
        chances = rng.beta(0.5, 0.5, 30)
        gains = rng.binomial(5, chances) - rng.binomial(5, chances)
        alarms += sign_flip_p([int(gain) for gain in gains]) <= 0.05
    assert 0.02 <= alarms / 2000 <= 0.05
