"""Accuracy as a function of the iteration budget on the same episodes: gain per step, saturation, and shape."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.records.episode import Record
from evaluator.statistics.intervals import FEWEST, Array, Proportion, proportion, resampled_means
from evaluator.statistics.paired import PairedDifference, holm, paired_difference

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
