"""Comparisons of accuracies on the same episodes: of two runs, and of several budgets."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from evaluator.records.episode import Record
from evaluator.statistics.intervals import (
    FEWEST,
    Array,
    Interval,
    Proportion,
    mean_interval,
    proportion,
    resampled_means,
)


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


MARGIN = 0.05
"""Difference of accuracy up to which two budgets count as equally good."""
LEVEL = 0.05
"""Significance level for a rise or fall: the probability of reporting one for a flat curve."""

_ROUNDING = 1e-9
"""Slack for floating-point rounding: 0.85 - 0.80 must not exceed a margin of 0.05."""


class CurveShape(StrEnum):
    """How accuracy changes as the budget grows."""

    RISING = "rising"
    """Some larger budget is better than a smaller one, and none is worse."""
    FALLING = "falling"
    FLAT = "flat"
    """No two budgets differ significantly."""
    MIXED = "mixed"
    """Some larger budget is better than a smaller one, and some other is worse."""


class BudgetPoint(Record):
    """One budget on a curve."""

    budget: int
    accuracy: Proportion
    gain: PairedDifference | None
    """Gain over the previous budget, on the same episodes; None for the first budget."""


class BudgetCurve(Record):
    """Accuracy against budget, on the episodes that were played with every budget."""

    n: int
    """Episodes at each budget."""
    n_scenes: int
    points: tuple[BudgetPoint, ...]
    shape: CurveShape
    certainty: float | None
    """Certainty of the shape, 0 to 1.

    Rising or falling: 1 minus the smallest adjusted p-value of a pair that rises or falls. Mixed: the smaller of these
    two. Flat: share of resamples in which no two budgets differ by more than `margin`; None if there are too few scenes
    to resample.
    """
    enough: int
    """The point of diminishing returns: the smallest budget that no larger one exceeds by more than `margin`.

    It is the largest budget if gains have not ended within the curve."""
    enough_certainty: float | None
    """Share of resamples in which no larger budget exceeds `enough` by more than `margin`; None for the largest."""
    margin: float


class Cell(NamedTuple):
    """The verdicts of one scene, seed and epoch at each budget."""

    scene: int
    verdicts: tuple[bool, ...]
    """The verdicts in the order of the budgets."""


def budget_curve(budgets: Sequence[int], cells: Sequence[Cell], margin: float = MARGIN) -> BudgetCurve:
    """Compute the curve of accuracy against budget.

    Every pair of budgets is compared on the same episodes (by McNemar's test or by sign flips of scenes), with p-values
    adjusted by Holm's method over all pairs. The shape follows from the differences significant at the 5 % level.

    Args:
        budgets: At least two, ascending.
        cells: The episodes that were scored at every budget.
        margin: Difference of accuracy that does not matter.

    Raises:
        ValueError: There are fewer than two budgets, they do not ascend, or there are no cells.
    """
    if len(budgets) < 2 or list(budgets) != sorted(set(budgets)):
        raise ValueError("a curve needs two or more budgets, ascending")
    pairs = list(itertools.combinations(range(len(budgets)), 2))
    compared = {pair: _between(cells, *pair) for pair in pairs}
    resampled = _resampled(cells)
    shape, certainty = _shape([compared[pair] for pair in pairs])
    if shape is CurveShape.FLAT:
        certainty = None if resampled is None else _share(np.ptp(resampled, axis=0) <= margin + _ROUNDING)
    accuracies = [proportion((cell.scene, cell.verdicts[index]) for cell in cells) for index in range(len(budgets))]
    enough = _enough([accuracy.share for accuracy in accuracies], margin)
    return BudgetCurve(
        n=len(cells),
        n_scenes=accuracies[0].n_scenes,
        points=tuple(
            BudgetPoint(budget=budget, accuracy=accuracies[index], gain=compared.get((index - 1, index)))
            for index, budget in enumerate(budgets)
        ),
        shape=shape,
        certainty=certainty,
        enough=budgets[enough],
        enough_certainty=_enough_certainty(resampled, enough, margin),
        margin=margin,
    )


def _between(cells: Sequence[Cell], smaller: int, larger: int) -> PairedDifference:
    return paired_difference((cell.scene, cell.verdicts[smaller], cell.verdicts[larger]) for cell in cells)


def _shape(compared: Sequence[PairedDifference]) -> tuple[CurveShape, float | None]:
    """Return the shape and its certainty from the differences of all pairs of budgets; None for a flat shape."""
    p_values = holm([pair.p_value for pair in compared])
    rise = min((p for p, pair in zip(p_values, compared, strict=True) if pair.difference > 0), default=1.0)
    fall = min((p for p, pair in zip(p_values, compared, strict=True) if pair.difference < 0), default=1.0)
    if max(rise, fall) <= LEVEL:
        return CurveShape.MIXED, 1 - max(rise, fall)
    if min(rise, fall) > LEVEL:
        return CurveShape.FLAT, None
    return (CurveShape.RISING, 1 - rise) if rise <= LEVEL else (CurveShape.FALLING, 1 - fall)


def _resampled(cells: Sequence[Cell]) -> Array | None:
    """Return accuracies (budgets, resamples) over resampled scenes; None if there are too few scenes."""
    right: defaultdict[int, list[int]] = defaultdict(lambda: [0] * len(cells[0].verdicts))
    size: Counter[int] = Counter()
    single = len({cell.scene for cell in cells}) == 1
    for index, cell in enumerate(cells):
        unit = index if single else cell.scene
        size[unit] += 1
        right[unit] = [count + verdict for count, verdict in zip(right[unit], cell.verdicts, strict=True)]
    if len(size) < FEWEST:
        return None
    return resampled_means(list(zip(*right.values(), strict=True)), list(size.values()))


def _enough(accuracies: Sequence[float], margin: float) -> int:
    """Return the index of the smallest budget that no larger one exceeds by more than the margin."""
    return next(
        index for index, accuracy in enumerate(accuracies) if max(accuracies[index:]) - accuracy <= margin + _ROUNDING
    )


def _enough_certainty(resampled: Array | None, enough: int, margin: float) -> float | None:
    if resampled is None or enough == len(resampled) - 1:
        return None
    further_gain = resampled[enough + 1 :].max(axis=0) - resampled[enough]
    return _share(further_gain <= margin + _ROUNDING)


def _share(claims: NDArray[np.bool_]) -> float:
    return np.count_nonzero(claims) / claims.size
