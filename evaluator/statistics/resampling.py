"""The bootstrap over scenes: how much a mean would vary with other scenes of the same kind."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from evaluator.statistics.intervals import Interval, wilson_interval

RESAMPLES = 4999
"""Number of resamples of every bootstrap."""
SEED = 0
"""Fixed random seed, so that the same verdicts give the same interval."""
FEWEST = 8
"""Least number of units for a bootstrap: with five scenes the 95 % interval had a coverage of 84 %."""

Array = NDArray[np.float64]


def resampled_means(totals: Sequence[Sequence[float]], counts: Sequence[float]) -> Array:
    """Resampled means of several quantities over units. All quantities use the same resamples.

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
    """95 % interval of a mean over units, by the expanded percentile bootstrap.

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
