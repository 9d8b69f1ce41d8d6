"""Compares two accuracies on the same episodes: difference, interval and p-value."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from enum import StrEnum

import numpy as np
import scipy

from evaluator.records.episode import Record
from evaluator.statistics.intervals import Interval, mean_interval


class PairedTest(StrEnum):
    """The test that gave a p-value."""

    MCNEMAR = "mcnemar-exact"
    """Every scene has one pair, or there is only one scene."""
    SIGN_FLIP = "sign-flip-by-scene"
    """Some scenes have several pairs: the signs of all pairs of a scene are flipped together."""


class PairedDifference(Record):
    """The gain in accuracy of the second of two verdicts over the first, on the same episodes."""

    n: int
    """Pairs: the denominator of both accuracies."""
    n_scenes: int
    first_correct: int
    second_correct: int
    only_first: int
    """Pairs that only the first has right."""
    only_second: int
    difference: float
    """Accuracy of the second minus accuracy of the first."""
    interval: Interval | None
    """95 % interval of the difference, by bootstrap over scenes; None if there are too few scenes."""
    p_value: float
    """Two-sided, for the null hypothesis of no difference."""
    test: PairedTest


def paired_difference(pairs: Iterable[tuple[int, bool, bool]]) -> PairedDifference:
    """Compare two verdicts on the same episodes.

    Args:
        pairs: Scene, whether the first was right, whether the second was.

    Raises:
        ValueError: There are no pairs.
    """
    rows = list(pairs)
    if not rows:
        raise ValueError("a comparison needs at least one pair")
    scenes = {scene for scene, _, _ in rows}
    # With one scene its episodes are the sampling units, otherwise the scenes are.
    gains: defaultdict[int, list[int]] = defaultdict(list)
    for index, (scene, first, second) in enumerate(rows):
        gains[index if len(scenes) == 1 else scene].append(second - first)
    only = Counter(second - first for _, first, second in rows)
    totals = [sum(unit) for unit in gains.values()]
    clustered = len(gains) < len(rows)
    return PairedDifference(
        n=len(rows),
        n_scenes=len(scenes),
        first_correct=sum(first for _, first, _ in rows),
        second_correct=sum(second for _, _, second in rows),
        only_first=only[-1],
        only_second=only[1],
        difference=sum(totals) / len(rows),
        interval=mean_interval(totals, [len(unit) for unit in gains.values()]),
        p_value=sign_flip_p(totals) if clustered else mcnemar_p(only[-1], only[1]),
        test=PairedTest.SIGN_FLIP if clustered else PairedTest.MCNEMAR,
    )


def mcnemar_p(only_first: int, only_second: int) -> float:
    """Two-sided p-value of McNemar's exact conditional test; 1 if no pair differs.

    Source: McNemar 1947, Psychometrika 12, 153-157; the exact form is the binomial test of `scipy.stats`.
    """
    if only_first + only_second == 0:
        return 1.0
    return float(scipy.stats.binomtest(only_first, only_first + only_second, 0.5).pvalue)


def sign_flip_p(differences: Sequence[int]) -> float:
    """Return the two-sided p-value of a sum of differences under random signs.

    The test is exact: it counts all 2ⁿ assignments of signs. The differences are integers, so the distribution of their
    sum is computed by adding one difference at a time. If all differences are ±1, it is McNemar's exact test.

    Args:
        differences: For each scene, the number of right episodes of the second minus that of the first.

    Source: Fisher 1935, The Design of Experiments, section 21.
    """
    largest = sum(abs(difference) for difference in differences)
    chances = np.zeros(2 * largest + 1)
    chances[largest] = 1.0
    for difference in differences:
        # np.roll never wraps non-zero chances, because no sum lies outside [-largest, largest].
        chances = (np.roll(chances, difference) + np.roll(chances, -difference)) / 2
    sums = np.abs(np.arange(-largest, largest + 1))
    return min(1.0, float(chances[sums >= abs(sum(differences))].sum()))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values adjusted by Holm's method, which controls the family-wise error rate.

    Source: Holm 1979, Scandinavian Journal of Statistics 6, 65-70; `scipy.stats` controls only false discovery rates.
    """
    adjusted, highest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        highest = max(highest, min(1.0, p_values[index] * (len(p_values) - rank)))
        adjusted[index] = highest
    return adjusted
