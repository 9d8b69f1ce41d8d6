"""Tests of the bootstrap over scenes against a published example and simulated runs."""

import numpy as np
import pytest

from evaluator.statistics.intervals import FEWEST, mean_interval, resampled_means, wilson_interval

# Efron and Tibshirani 1993, table 10.1: old patch minus placebo, and new patch minus old patch.
OLD_OVER_PLACEBO = [8406, 2342, 8187, 8459, 4795, 3516, 4796, 10238]
NEW_OVER_OLD = [-1200, 2601, -2705, 1982, -1290, 351, -638, -2719]


def test_a_ratio_of_means_has_the_published_bootstrap_error() -> None:
    """Efron and Tibshirani 1993, section 10.3: ratio -0.0713, bootstrap standard error 0.105 from 400 resamples.

    The relative error of a standard error from 400 resamples is about 1/√800, here 0.004 in absolute terms.
    """
    assert sum(NEW_OVER_OLD) / sum(OLD_OVER_PLACEBO) == pytest.approx(-0.0713, abs=5e-5)
    (drawn,) = resampled_means([NEW_OVER_OLD], OLD_OVER_PLACEBO)
    assert drawn.std(ddof=1) == pytest.approx(0.105, abs=0.004)


def test_all_quantities_use_the_same_resamples() -> None:
    first, second = resampled_means([[1, 0, 1, 0], [0, 1, 0, 1]], [1, 1, 1, 1])
    assert np.allclose(first + second, 1)
    assert len(set(first)) == 5


def test_the_same_verdicts_give_the_same_interval() -> None:
    totals, counts = [0, 1, -1, 1, 0, 1, 0, 0, 2, 1], [2] * 10
    assert mean_interval(totals, counts) == mean_interval(totals, counts)


def test_too_few_scenes_give_no_bootstrap() -> None:
    assert mean_interval([0, 1] * 3 + [1], [1] * (FEWEST - 1)) is None
    assert mean_interval([0, 1] * 4, [1] * FEWEST) is not None


def test_if_all_scenes_agree_the_interval_allows_for_unseen_scenes() -> None:
    unseen = wilson_interval(0, 20).high
    assert unseen == pytest.approx(0.1611, abs=5e-5)  # Newcombe 1998: 0 of 20
    same = mean_interval([0] * 20, [3] * 20)
    every = mean_interval([3] * 20, [3] * 20)
    share = mean_interval([1.0] * 20, [1.0] * 20, lowest=0.0)
    assert same is not None
    assert every is not None
    assert share is not None
    assert (same.low, same.high) == pytest.approx((-unseen, unseen))
    assert (every.low, every.high) == pytest.approx((1 - 2 * unseen, 1))
    assert (share.low, share.high) == pytest.approx((1 - unseen, 1))


@pytest.mark.parametrize(
    ("scenes", "seeds", "first", "second"),
    [
        pytest.param(105, 1, 0.4, 0.55, marks=pytest.mark.extended),
        pytest.param(105, 5, 0.9, 0.9, marks=pytest.mark.extended),
        (35, 5, 0.5, 0.6),
        (15, 5, 0.4, 0.6),
    ],
)
def test_the_95_per_cent_interval_of_a_difference_has_a_coverage_of_93_to_97(
    scenes: int, seeds: int, first: float, second: float
) -> None:
    """Simulates pairs of agents whose chances share a component per scene, so that pairing matters."""
    rng = np.random.default_rng(8)
    common = 0.25
    covered = 0
    for _ in range(600):
        # Chance in each scene: a part common to both agents plus a part of each agent's own, with the wanted mean.
        shared = rng.random(scenes)
        chances = [
            common * (shared < mean) + (1 - common) * rng.beta(mean, 1 - mean, scenes) for mean in (first, second)
        ]
        right = [rng.binomial(seeds, chance) for chance in chances]
        found = mean_interval([int(gain) for gain in right[1] - right[0]], [seeds] * scenes)
        assert found is not None
        covered += found.low <= second - first <= found.high
    assert 0.93 <= covered / 600 <= 0.97
