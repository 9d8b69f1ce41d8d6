"""Several tries at one scene: pass@k, that one of k succeeds, and pass^k, that all k do."""

import math
from collections.abc import Mapping, Sequence

from evaluator.records import Record
from evaluator.statistics.intervals import Interval
from evaluator.statistics.resampling import mean_interval


class AttemptPoint(Record):
    """Both at one k, as means over scenes."""

    k: int
    pass_at_k: float
    pass_at_k_interval: Interval | None
    """95 %, bootstrap over scenes; None for too few."""
    pass_hat_k: float
    pass_hat_k_interval: Interval | None


class Attempts(Record):
    """pass@k and pass^k of one condition."""

    n: int
    """Scored episodes."""
    n_scenes: int
    """Scenes: the denominator of the means."""
    tries: int
    """Scored episodes of the scene that has fewest: the largest k that every scene can tell of."""
    points: tuple[AttemptPoint, ...]
    """At 1, at powers of two, and at `tries`."""


def pass_at_k(tries: int, successes: int, k: int) -> float:
    """Unbiased estimate of the chance that at least one of k tries succeeds.

    Raises:
        ValueError: k is below 1 or above the tries made.

    Source: Chen et al. 2021, arXiv:2107.03374, equation 1: 1 - C(n - c, k) / C(n, k).
    """
    _check(tries, k)
    return 1 - math.comb(tries - successes, k) / math.comb(tries, k)


def pass_hat_k(tries: int, successes: int, k: int) -> float:
    """Unbiased estimate of the chance that all of k tries succeed.

    Raises:
        ValueError: k is below 1 or above the tries made.

    Source: Yao et al. 2024, arXiv:2406.12045, section 4: C(c, k) / C(n, k).
    """
    _check(tries, k)
    return math.comb(successes, k) / math.comb(tries, k)


def _check(tries: int, k: int) -> None:
    if not 1 <= k <= tries:
        raise ValueError(f"{tries} tries say nothing of {k}")


def attempts(verdicts: Mapping[int, Sequence[bool]]) -> Attempts | None:
    """pass@k and pass^k over scenes.

    Args:
        verdicts: Scene → verdicts of its scored episodes under one condition, whatever their seeds and epochs.

    Returns:
        None where a scene has a single try, or there is no scene: then there is nothing beyond accuracy to tell.
    """
    tries = min(map(len, verdicts.values()), default=0)
    if tries < 2:
        return None
    powers = [2**power for power in range(tries.bit_length()) if 2**power < tries]
    return Attempts(
        n=sum(map(len, verdicts.values())),
        n_scenes=len(verdicts),
        tries=tries,
        points=tuple(_point(verdicts, k) for k in (*powers, tries)),
    )


def _point(verdicts: Mapping[int, Sequence[bool]], k: int) -> AttemptPoint:
    some = [pass_at_k(len(one), sum(one), k) for one in verdicts.values()]
    every = [pass_hat_k(len(one), sum(one), k) for one in verdicts.values()]
    once = [1.0] * len(some)
    return AttemptPoint(
        k=k,
        pass_at_k=math.fsum(some) / len(some),
        pass_at_k_interval=mean_interval(some, once, lowest=0.0),
        pass_hat_k=math.fsum(every) / len(every),
        pass_hat_k_interval=mean_interval(every, once, lowest=0.0),
    )
