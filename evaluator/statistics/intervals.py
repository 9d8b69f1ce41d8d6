"""Estimates with 95 % intervals over scenes: accuracy by Wilson's method, means by the bootstrap, pass@k and pass^k."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from statistics import NormalDist
from typing import Any

import numpy as np
import scipy  # loads its submodules on first use, so commands without statistics do not wait for them
from numpy.typing import NDArray

from evaluator.records.episode import Record

Z_95 = NormalDist().inv_cdf(0.975)


class Interval(Record):
    """A 95 % confidence interval."""

    low: float
    high: float


class IntervalMethod(StrEnum):
    """The method that gave the interval of an accuracy."""

    WILSON = "wilson"
    """Every scene has one episode, or there is only one scene: episodes count as independent."""
    CLUSTERED = "wilson-clustered"
    """Some scenes have several episodes: Wilson's interval on the effective number of episodes."""


class Proportion(Record):
    """The share of right episodes, with its interval and sample sizes."""

    n: int
    """Episodes: the denominator."""
    n_correct: int
    n_scenes: int
    share: float
    interval: Interval
    method: IntervalMethod
    effective_n: float
    """Number of independent episodes that would give the same precision."""


def wilson_interval(successes: float, trials: float) -> Interval:
    """Return the 95 % interval of a proportion by Wilson's score method.

    Unlike `scipy.stats`, this accepts fractional counts, which an effective number of episodes requires.

    Raises:
        ValueError: There are no trials.

    Source: Wilson 1927; examples in Newcombe 1998, Statistics in Medicine 17, 857-872, table I.
    """
    if trials <= 0:
        raise ValueError("an interval needs at least one trial")
    share, square = successes / trials, Z_95**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = Z_95 / (1 + square / trials) * math.sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    # If none or all succeeded, return exactly 0 or 1, despite rounding.
    low = 0.0 if successes == 0 else centre - half
    return Interval(low=low, high=1.0 if successes == trials else centre + half)


def design_effect(correct: Sequence[int], episodes: Sequence[int]) -> float:
    """The factor by which correlation within scenes increases the variance of an accuracy.

    Args:
        correct: Number of right episodes of each scene.
        episodes: Number of episodes of each scene.

    Returns:
        The design effect. If all episodes are right or all are wrong, the value for perfect correlation within scenes.

    Source: Rao and Scott 1992, Biometrics 48, 577-585: cluster ratio variance divided by binomial variance.
    """
    n, scenes = sum(episodes), len(episodes)
    share = sum(correct) / n
    if share in {0.0, 1.0}:
        return sum(size**2 for size in episodes) / n
    residuals = sum((right - share * size) ** 2 for right, size in zip(correct, episodes, strict=True))
    return scenes / (scenes - 1) * residuals / n**2 / (share * (1 - share) / n)


def proportion(verdicts: Iterable[tuple[int, bool]]) -> Proportion:
    """Return the share of right episodes with its 95 % interval.

    With one episode per scene, this is Wilson's interval. Otherwise it is Wilson's interval on n / deff · (z / t)²
    episodes. The design effect deff corrects for correlation within scenes and is taken as at least 1. The quantile t
    has one degree of freedom less than there are scenes and corrects for deff being an estimate.

    Args:
        verdicts: Scene of each scored episode, and whether it was right.

    Raises:
        ValueError: There are no episodes.

    Source: Korn and Graubard 1998, Survey Methodology 24, 193-201, for the effective sample size; Franco, Little, Louis
    and Slud 2019, Journal of Survey Statistics and Methodology 7, 334-364, for Wilson's interval on it.
    """
    rows = list(verdicts)
    size = Counter(scene for scene, _ in rows)
    right = Counter(scene for scene, correct in rows if correct)
    n, n_correct, scenes = len(rows), right.total(), len(size)
    if not n:
        raise ValueError("a share needs at least one episode")
    clustered = 1 < scenes < n
    effective = float(n)
    if clustered:
        t = float(scipy.special.stdtrit(scenes - 1, 0.975))
        effective *= (Z_95 / t) ** 2 / max(1.0, design_effect([right[scene] for scene in size], list(size.values())))
    return Proportion(
        n=n,
        n_correct=n_correct,
        n_scenes=scenes,
        share=n_correct / n,
        # If all n episodes are right, the successes equal the effective number exactly, so the upper end is exactly 1.
        interval=wilson_interval(effective if n_correct == n else effective * n_correct / n, effective),
        method=IntervalMethod.CLUSTERED if clustered else IntervalMethod.WILSON,
        effective_n=effective,
    )


RESAMPLES = 4999
"""Number of resamples of every bootstrap."""
SEED = 0
"""Fixed random seed, so that the same verdicts give the same interval."""
FEWEST = 8
"""Smallest number of units for a bootstrap: with five scenes the 95 % interval had a coverage of 84 %."""

Array = NDArray[np.float64]


def resampled_means(totals: Sequence[Sequence[float]], counts: Sequence[float]) -> Array:
    """Resample means of several quantities over units. All quantities use the same resamples.

    Args:
        totals: Sum of each quantity in each unit, (quantities, units).
        counts: Number of terms in these sums for each unit, (units,).

    Returns:
        Means (quantities, resamples): sum of the totals divided by sum of the counts.

    Source: `scipy.stats.bootstrap`, paired over quantities.
    """
    return np.asarray(_bootstrap(totals, counts, 0.95).bootstrap_distribution, dtype=np.float64)


def mean_interval(
    totals: Sequence[float], counts: Sequence[float], lowest: float = -1.0, highest: float = 1.0
) -> Interval | None:
    """Return the 95 % interval of a mean over units by the expanded percentile bootstrap.

    Args:
        totals: Sum of the quantity in each unit.
        counts: Number of terms in each sum.
        lowest: Smallest possible value of the quantity.
        highest: Largest possible value.

    Returns:
        The interval; None for fewer than `FEWEST` units. If all units agree, all resamples are equal; then the interval
        assumes that a share of unseen units has the extreme value, up to Wilson's 95 % bound for 0 of n.

    Source: Efron and Tibshirani 1993, chapter 13; expansion: Hesterberg 2015, American Statistician 69, 371-386.
    """
    units = len(totals)
    if units < FEWEST:
        return None
    means = [total / count for total, count in zip(totals, counts, strict=True)]
    if max(means) == min(means):
        unseen = wilson_interval(0, units).high
        return Interval(
            low=means[0] - unseen * (means[0] - lowest),
            high=means[0] + unseen * (highest - means[0]),
        )
    # A percentile interval is too narrow by √((n−1)/n) and uses z instead of t. A smaller tail corrects for both.
    t = float(scipy.special.stdtrit(units - 1, 0.975))
    tail = float(scipy.special.ndtr(-math.sqrt(units / (units - 1)) * t))
    found = _bootstrap([totals], counts, 1 - 2 * tail).confidence_interval
    return Interval(low=float(found.low[0]), high=float(found.high[0]))


def _bootstrap(totals: Sequence[Sequence[float]], counts: Sequence[float], level: float) -> Any:
    def means(*drawn: Array, axis: int = -1) -> Array:
        *sums, sizes = drawn
        return np.stack([total.sum(axis=axis) for total in sums]) / sizes.sum(axis=axis)

    data = tuple(np.asarray(values, dtype=np.float64) for values in (*totals, counts))
    return scipy.stats.bootstrap(
        data,
        means,
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=500,
        confidence_level=level,
        method="percentile",
        rng=np.random.default_rng(SEED),
    )


class AttemptPoint(Record):
    """pass@k and pass^k for one value of k, as means over scenes."""

    k: int
    pass_at_k: float
    pass_at_k_interval: Interval | None
    """95 %, bootstrap over scenes; None if there are too few scenes."""
    pass_hat_k: float
    pass_hat_k_interval: Interval | None


class Attempts(Record):
    """pass@k and pass^k of one condition."""

    n: int
    """Scored episodes."""
    n_scenes: int
    """Scenes: the denominator of the means."""
    tries: int
    """Smallest number of scored episodes of any scene: the largest k that can be estimated for all scenes."""
    points: tuple[AttemptPoint, ...]
    """The points at k = 1, at powers of two, and at `tries`."""


def pass_at_k(tries: int, successes: int, k: int) -> float:
    """Return the unbiased estimate of the probability that at least one of k tries succeeds.

    Raises:
        ValueError: k is below 1 or above the number of tries.

    Source: Chen et al. 2021, arXiv:2107.03374, equation 1: 1 - C(n - c, k) / C(n, k).
    """
    _check_tries(tries, k)
    return 1 - math.comb(tries - successes, k) / math.comb(tries, k)


def pass_hat_k(tries: int, successes: int, k: int) -> float:
    """Return the unbiased estimate of the probability that all of k tries succeed.

    Raises:
        ValueError: k is below 1 or above the number of tries.

    Source: Yao et al. 2024, arXiv:2406.12045, section 4: C(c, k) / C(n, k).
    """
    _check_tries(tries, k)
    return math.comb(successes, k) / math.comb(tries, k)


def _check_tries(tries: int, k: int) -> None:
    if not 1 <= k <= tries:
        raise ValueError(f"k must lie between 1 and the number of tries, {tries}; it is {k}")


def attempts(verdicts: Mapping[int, Sequence[bool]]) -> Attempts | None:
    """Estimate pass@k and pass^k over scenes.

    Args:
        verdicts: Scene → verdicts of its scored episodes under one condition, over all seeds and epochs.

    Returns:
        None if there are no scenes or a scene has a single try: pass@1 and pass^1 equal the accuracy.
    """
    tries = min(map(len, verdicts.values()), default=0)
    if tries < 2:
        return None
    powers = [2**power for power in range(tries.bit_length()) if 2**power < tries]
    return Attempts(
        n=sum(map(len, verdicts.values())),
        n_scenes=len(verdicts),
        tries=tries,
        points=tuple(_attempt_point(verdicts, k) for k in (*powers, tries)),
    )


def _attempt_point(verdicts: Mapping[int, Sequence[bool]], k: int) -> AttemptPoint:
    any_succeeds = [pass_at_k(len(tries), sum(tries), k) for tries in verdicts.values()]
    all_succeed = [pass_hat_k(len(tries), sum(tries), k) for tries in verdicts.values()]
    weights = [1.0] * len(verdicts)
    return AttemptPoint(
        k=k,
        pass_at_k=math.fsum(any_succeeds) / len(verdicts),
        pass_at_k_interval=mean_interval(any_succeeds, weights, lowest=0.0),
        pass_hat_k=math.fsum(all_succeed) / len(verdicts),
        pass_hat_k_interval=mean_interval(all_succeed, weights, lowest=0.0),
    )
