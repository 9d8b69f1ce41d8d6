"""pass@k, the chance that at least one of k tries succeeds, and pass^k, the chance that all k succeed."""

import math
from collections.abc import Mapping, Sequence

from evaluator.records.episode import Record
from evaluator.statistics.intervals import Interval, mean_interval


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
    _check(tries, k)
    return 1 - math.comb(tries - successes, k) / math.comb(tries, k)


def pass_hat_k(tries: int, successes: int, k: int) -> float:
    """Return the unbiased estimate of the probability that all of k tries succeed.

    Raises:
        ValueError: k is below 1 or above the number of tries.

    Source: Yao et al. 2024, arXiv:2406.12045, section 4: C(c, k) / C(n, k).
    """
    _check(tries, k)
    return math.comb(successes, k) / math.comb(tries, k)


def _check(tries: int, k: int) -> None:
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
        points=tuple(_point(verdicts, k) for k in (*powers, tries)),
    )


def _point(verdicts: Mapping[int, Sequence[bool]], k: int) -> AttemptPoint:
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
