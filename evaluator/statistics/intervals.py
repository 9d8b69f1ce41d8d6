"""Intervals of one accuracy: Wilson's, and the same on the effective number of episodes where scenes repeat."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from enum import StrEnum
from statistics import NormalDist

import scipy  # its parts load when first used: a command that reports nothing does not wait for them

from evaluator.records import Record

Z_95 = NormalDist().inv_cdf(0.975)


class Interval(Record):
    """A 95 % confidence interval."""

    low: float
    high: float


class IntervalMethod(StrEnum):
    """How the interval of an accuracy came about."""

    WILSON = "wilson"
    """Every scene gave one episode, or there is but one scene: episodes are independent."""
    CLUSTERED = "wilson-clustered"
    """Scenes gave several episodes: Wilson on the effective number of episodes."""


class Proportion(Record):
    """A share of right episodes, with everything needed to judge it."""

    n: int
    """Episodes: the denominator."""
    n_correct: int
    n_scenes: int
    share: float
    interval: Interval
    method: IntervalMethod
    effective_n: float
    """Independent episodes that would tell as much."""


def wilson_interval(successes: float, trials: float) -> Interval:
    """95 % interval of a proportion, by Wilson's score method.

    Takes fractions of trials too, which `scipy.stats` does not: an effective number of episodes is seldom whole.

    Raises:
        ValueError: There are no trials.

    Source: Wilson 1927; examples in Newcombe 1998, Statistics in Medicine 17, 857-872, table I.
    """
    if trials <= 0:
        raise ValueError("an interval needs at least one trial")
    share, square = successes / trials, Z_95**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = Z_95 / (1 + square / trials) * math.sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    # At 0 and at all, the bound is 0 or 1 exactly; rounding must not leave it beside.
    low = 0.0 if successes == 0 else centre - half
    return Interval(low=low, high=1.0 if successes == trials else centre + half)


def design_effect(correct: Sequence[int], episodes: Sequence[int]) -> float:
    """How many times larger the variance of an accuracy is because episodes come in scenes.

    Args:
        correct: Right episodes of each scene.
        episodes: All episodes of each scene.

    Returns:
        The design effect; where all episodes are right, or all wrong, that of scenes whose episodes always agree.

    Source: Rao and Scott 1992, Biometrics 48, 577-585: variance of a ratio over clusters by that of a binomial.
    """
    n, scenes = sum(episodes), len(episodes)
    share = sum(correct) / n
    if share in {0.0, 1.0}:
        return sum(size**2 for size in episodes) / n
    residuals = sum((right - share * size) ** 2 for right, size in zip(correct, episodes, strict=True))
    return scenes / (scenes - 1) * residuals / n**2 / (share * (1 - share) / n)


def proportion(verdicts: Iterable[tuple[int, bool]]) -> Proportion:
    """The share of right episodes with its 95 % interval.

    With one episode a scene, Wilson's interval. Otherwise Wilson's on n / deff · (z / t)² episodes: the design effect
    stands for what scenes share, and the quantile t, of one degree of freedom less than there are scenes, for its
    being estimated. The design effect counts as at least 1: scenes do not make episodes more telling.

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
        effective *= (Z_95 / t) ** 2 / max(1.0, design_effect([right[one] for one in size], list(size.values())))
    return Proportion(
        n=n,
        n_correct=n_correct,
        n_scenes=scenes,
        share=n_correct / n,
        # Its ends stay exact: 0 of n and n of n are 0 and all of the effective number too.
        interval=wilson_interval(effective if n_correct == n else effective * n_correct / n, effective),
        method=IntervalMethod.CLUSTERED if clustered else IntervalMethod.WILSON,
        effective_n=effective,
    )
