"""Two accuracies on the same episodes: their difference, its interval, and whether chance alone would do."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from enum import StrEnum

import numpy as np
import scipy

from evaluator.records import Record
from evaluator.statistics.intervals import Interval
from evaluator.statistics.resampling import mean_interval


class PairedTest(StrEnum):
    """How a p-value came about."""

    MCNEMAR = "mcnemar-exact"
    """Every scene gave one pair, or there is but one scene."""
    SIGN_FLIP = "sign-flip-by-scene"
    """Scenes gave several pairs: the pairs of a scene change sides together."""


class PairedDifference(Record):
    """What the second of two verdicts on the same episodes gained over the first."""

    n: int
    """Pairs: the denominator of both accuracies."""
    n_scenes: int
    first_correct: int
    second_correct: int
    only_first: int
    """Pairs that the first alone has right."""
    only_second: int
    difference: float
    """Accuracy of the second less that of the first."""
    interval: Interval | None
    """95 %, bootstrap over scenes; None for too few."""
    p_value: float
    """Two-sided, of no difference."""
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
    # Within one scene its episodes are the sample; across scenes, scenes are.
    gains: defaultdict[int, list[int]] = defaultdict(list)
    for index, (scene, first, second) in enumerate(rows):
        gains[index if len(scenes) == 1 else scene].append(second - first)
    only = Counter(second - first for _, first, second in rows)
    totals = [sum(one) for one in gains.values()]
    clustered = len(gains) < len(rows)
    return PairedDifference(
        n=len(rows),
        n_scenes=len(scenes),
        first_correct=sum(first for _, first, _ in rows),
        second_correct=sum(second for _, _, second in rows),
        only_first=only[-1],
        only_second=only[1],
        difference=sum(totals) / len(rows),
        interval=mean_interval(totals, [len(one) for one in gains.values()]),
        p_value=sign_flip_p(totals) if clustered else mcnemar_p(only[-1], only[1]),
        test=PairedTest.SIGN_FLIP if clustered else PairedTest.MCNEMAR,
    )


def mcnemar_p(only_first: int, only_second: int) -> float:
    """Two-sided p-value of McNemar's exact conditional test; 1 where no pair differs.

    Source: McNemar 1947, Psychometrika 12, 153-157; the exact form is the binomial test of `scipy.stats`.
    """
    if only_first + only_second == 0:
        return 1.0
    return float(scipy.stats.binomtest(only_first, only_first + only_second, 0.5).pvalue)


def sign_flip_p(differences: Sequence[int]) -> float:
    """Two-sided p-value of the sum of the differences, were the sign of each as likely to be the other.

    All 2ⁿ assignments of signs count, none is sampled: the differences are whole, so their sums are few, and the
    distribution builds up one difference at a time. With differences of one alone it is McNemar's exact test.

    Args:
        differences: One for each scene: right episodes of the second less those of the first.

    Source: Fisher 1935, The Design of Experiments, section 21.
    """
    reach = sum(abs(one) for one in differences)
    chances = np.zeros(2 * reach + 1)
    chances[reach] = 1.0
    for one in differences:
        # Nothing wraps round: no sum leaves [-reach, reach].
        chances = (np.roll(chances, one) + np.roll(chances, -one)) / 2
    sums = np.abs(np.arange(-reach, reach + 1))
    return min(1.0, float(chances[sums >= abs(sum(differences))].sum()))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values adjusted so that a false alarm anywhere in the family stays as rare as in a single test.

    Source: Holm 1979, Scandinavian Journal of Statistics 6, 65-70; `scipy.stats` has false discovery rates alone.
    """
    adjusted, highest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        highest = max(highest, min(1.0, p_values[index] * (len(p_values) - rank)))
        adjusted[index] = highest
    return adjusted
