"""Tests of intervals against published examples, SciPy, and simulated runs with a known accuracy."""

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.statistics.intervals import IntervalMethod, design_effect, proportion, wilson_interval

# Litters: (pups alive at 4 days, those still alive at 21 days). Weil 1970, from Rao and Scott 1992, table 1.
CONTROL = [
    *((13, 13), (12, 12), (9, 9), (9, 9), (8, 8), (8, 8), (13, 12), (12, 11)),
    *((10, 9), (10, 9), (9, 8), (13, 11), (5, 4), (7, 5), (10, 7), (10, 7)),
]
TREATED = [
    *((12, 12), (11, 11), (10, 10), (9, 9), (11, 10), (10, 9), (10, 9), (9, 8)),
    *((9, 8), (5, 4), (9, 7), (7, 4), (10, 5), (6, 3), (10, 3), (7, 0)),
]


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_the_wilson_interval_matches_published_examples(successes: int, trials: int, low: float, high: float) -> None:
    """Newcombe 1998, Statistics in Medicine 17, 857-872, table I, method 3 (score without continuity correction)."""
    interval = wilson_interval(successes, trials)
    assert (round(interval.low, 4), round(interval.high, 4)) == (low, high)
    mirrored = wilson_interval(trials - successes, trials)
    assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((interval.low, interval.high))


@settings(max_examples=100)
@given(trials=st.integers(min_value=1, max_value=500), data=st.data())
def test_the_wilson_interval_matches_scipy_for_whole_numbers(trials: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(min_value=0, max_value=trials))
    interval = wilson_interval(successes, trials)
    theirs = scipy.stats.binomtest(successes, trials).proportion_ci(method="wilson")
    assert (interval.low, interval.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)
    assert 0 <= interval.low <= successes / trials <= interval.high <= 1


def test_no_trials_or_episodes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one trial"):
        wilson_interval(0, 0)
    with pytest.raises(ValueError, match="at least one episode"):
        proportion([])


@pytest.mark.parametrize(("litters", "published"), [(CONTROL, 1.232495), (TREATED, 3.952861)])
def test_the_design_effect_matches_the_published_value(litters: list[tuple[int, int]], published: float) -> None:
    """Rao and Scott 1992, Biometrics 48, 577-585, table 1; six digits from the example of `rsb` in R's package PF."""
    found = design_effect([alive for _, alive in litters], [size for size, _ in litters])
    assert found == pytest.approx(published, abs=5e-7)


def test_the_clustered_interval_matches_a_manual_calculation() -> None:
    """Treated pups: 112 of 145 in 16 litters; t with 15 degrees of freedom is 2.131450 (from a table)."""
    verdicts = [(litter, pup < alive) for litter, (size, alive) in enumerate(TREATED) for pup in range(size)]
    found = proportion(verdicts)
    assert (found.n, found.n_correct, found.n_scenes) == (145, 112, 16)
    effective = 145 / 3.952861 * (1.959964 / 2.131450) ** 2
    assert found.method is IntervalMethod.CLUSTERED
    assert found.effective_n == pytest.approx(effective, rel=1e-5)
    assert found.interval == wilson_interval(found.effective_n * 112 / 145, found.effective_n)
    # Manual calculation with 31.017 pups: centre 0.742394, half width 0.142385.
    assert (found.interval.low, found.interval.high) == pytest.approx((0.6000, 0.8848), abs=1e-4)


def test_one_episode_per_scene_gives_the_plain_wilson_interval() -> None:
    found = proportion((scene, scene % 3 == 0) for scene in range(30))
    assert (found.method, found.effective_n) == (IntervalMethod.WILSON, 30)
    assert found.interval == wilson_interval(10, 30)


def test_with_a_single_scene_its_episodes_are_the_sample() -> None:
    found = proportion((7, seed < 14) for seed in range(20))
    assert (found.method, found.n_scenes) == (IntervalMethod.WILSON, 1)
    assert found.interval == wilson_interval(14, 20)


def test_repeating_the_same_verdicts_does_not_narrow_the_interval() -> None:
    once = proportion((scene, scene < 60) for scene in range(105))
    repeated = proportion((scene, scene < 60) for scene in range(105) for _ in range(20))
    assert repeated.effective_n == pytest.approx(104 * (1.959964 / 1.983037) ** 2, rel=1e-5)
    assert repeated.interval.low < once.interval.low < once.interval.high < repeated.interval.high


@pytest.mark.parametrize("right", [True, False])
def test_if_all_verdicts_agree_each_scene_counts_once(right: bool) -> None:
    found = proportion((scene, right) for scene in range(10) for _ in range(5))
    assert found.effective_n == pytest.approx(10 * (1.959964 / 2.262157) ** 2, rel=1e-5)
    assert (found.interval.high == 1.0, found.interval.low == 0.0) == (right, not right)


def test_the_design_effect_counts_as_at_least_1() -> None:
    found = proportion((scene, seed % 2 == 0) for scene in range(50) for seed in range(4))
    assert found.effective_n == pytest.approx(200 * (1.959964 / 2.009575) ** 2, rel=1e-5)


@settings(max_examples=100)
@given(sizes=st.lists(st.integers(min_value=1, max_value=9), min_size=1, max_size=12), data=st.data())
def test_the_interval_contains_the_share_and_lies_between_0_and_1(sizes: list[int], data: st.DataObject) -> None:
    verdicts = [(scene, data.draw(st.booleans())) for scene, size in enumerate(sizes) for _ in range(size)]
    found = proportion(verdicts)
    assert 0 <= found.interval.low <= found.share + 1e-12
    assert found.share - 1e-12 <= found.interval.high <= 1
    assert 0 < found.effective_n <= found.n


@pytest.mark.parametrize(
    ("scenes", "seeds", "accuracy", "correlation"),
    [
        pytest.param(105, 5, 0.3, 0.5, marks=pytest.mark.extended),
        pytest.param(105, 20, 0.8, 0.3, marks=pytest.mark.extended),
        (105, 3, 0.5, 0.9),
        (35, 5, 0.6, 0.5),
        (15, 5, 0.5, 0.5),
    ],
)
def test_the_95_per_cent_interval_has_a_coverage_of_93_to_97(
    scenes: int, seeds: int, accuracy: float, correlation: float
) -> None:
    """Simulated runs; the accuracies of scenes follow a beta distribution with the given correlation within scenes."""
    rng = np.random.default_rng(5)
    spread = 1 / correlation - 1
    covered = naive = 0
    for _ in range(1000):
        chances = rng.beta(accuracy * spread, (1 - accuracy) * spread, scenes)
        right = rng.random((scenes, seeds)) < chances[:, None]
        found = proportion((scene, bool(verdict)) for scene, verdicts in enumerate(right) for verdict in verdicts)
        covered += found.interval.low <= accuracy <= found.interval.high
        plain = wilson_interval(found.n_correct, found.n)
        naive += plain.low <= accuracy <= plain.high
    assert 0.93 <= covered / 1000 <= 0.97
    assert naive / 1000 < 0.85  # coverage if episodes counted as independent
