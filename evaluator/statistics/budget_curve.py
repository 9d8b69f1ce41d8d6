"""Accuracy against iteration budget on the same episodes: what each step gains, where gains end, which shape."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.records import Record
from evaluator.statistics.intervals import Proportion, proportion
from evaluator.statistics.paired import PairedDifference, holm, paired_difference
from evaluator.statistics.resampling import FEWEST, Array, resampled_means

MARGIN = 0.05
"""Difference of accuracy up to which two budgets count as equally good."""
LEVEL = 0.05
"""Chance of a rise or fall being seen anywhere in a curve that has none."""

_SHADE = 1e-9
"""0.85 - 0.80 is not to exceed a margin of 0.05 for the sake of its last bit."""


class Shape(StrEnum):
    """What accuracy does as the budget grows."""

    RISING = "rising"
    """Some larger budget is better than a smaller one, and none is worse."""
    FALLING = "falling"
    FLAT = "flat"
    """No two budgets can be told apart."""
    MIXED = "mixed"
    """Better somewhere, worse somewhere else."""


class BudgetPoint(Record):
    """One budget of a curve."""

    budget: int
    accuracy: Proportion
    gain: PairedDifference | None
    """Over the budget before, on the same episodes; None for the first."""


class BudgetCurve(Record):
    """Accuracy against budget, on the episodes that every budget played."""

    n: int
    """Episodes at each budget."""
    n_scenes: int
    points: tuple[BudgetPoint, ...]
    shape: Shape
    certainty: float | None
    """Of the shape, 0 to 1.

    Rising, falling: 1 - the least adjusted p-value of such a pair of budgets; mixed: the lesser of both. Flat: share of
    resamples in which no two budgets are more than `margin` apart; None for too few scenes to resample.
    """
    enough: int
    """The point of diminishing returns: the least budget that no larger one beats by more than `margin`.

    The largest budget where gains have not ended within the curve."""
    enough_certainty: float | None
    """Share of resamples in which no larger budget beats `enough` by more than `margin`; None if there is no larger."""
    margin: float


class Cell(NamedTuple):
    """An episode as played at each budget."""

    scene: int
    verdicts: tuple[bool, ...]
    """In the order of the budgets."""


def budget_curve(budgets: Sequence[int], cells: Sequence[Cell], margin: float = MARGIN) -> BudgetCurve:
    """The curve of accuracy against budget.

    Every pair of budgets is compared on the same episodes (McNemar, or sign flips by scene), the p-values adjusted by
    Holm's method over all pairs. The shape says which signs are left at the 5 % level.

    Args:
        budgets: At least two, ascending.
        cells: The episodes that every budget played and scored.
        margin: Difference of accuracy that does not matter.

    Raises:
        ValueError: There are fewer than two budgets, or no cells.
    """
    if len(budgets) < 2 or list(budgets) != sorted(set(budgets)):
        raise ValueError("a curve needs two or more budgets, ascending")
    pairs = list(itertools.combinations(range(len(budgets)), 2))
    compared = {pair: _between(cells, *pair) for pair in pairs}
    resampled = _resampled(cells)
    shape, certainty = _shape([compared[pair] for pair in pairs])
    if shape is Shape.FLAT:
        certainty = None if resampled is None else _share(np.ptp(resampled, axis=0) <= margin + _SHADE)
    accuracies = [proportion((cell.scene, cell.verdicts[index]) for cell in cells) for index in range(len(budgets))]
    enough = _enough([one.share for one in accuracies], margin)
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


def _shape(compared: Sequence[PairedDifference]) -> tuple[Shape, float | None]:
    """The shape that the differences of all pairs of budgets show, and how certain; a flat one is not judged here."""
    p_values = holm([one.p_value for one in compared])
    rise = min((p for p, one in zip(p_values, compared, strict=True) if one.difference > 0), default=1.0)
    fall = min((p for p, one in zip(p_values, compared, strict=True) if one.difference < 0), default=1.0)
    if max(rise, fall) <= LEVEL:
        return Shape.MIXED, 1 - max(rise, fall)
    if min(rise, fall) > LEVEL:
        return Shape.FLAT, None
    return (Shape.RISING, 1 - rise) if rise <= LEVEL else (Shape.FALLING, 1 - fall)


def _resampled(cells: Sequence[Cell]) -> Array | None:
    """Accuracies (budgets, resamples) with scenes drawn anew; None for too few."""
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
    """Index of the least budget that no larger one beats by more than the margin."""
    return next(
        index for index, accuracy in enumerate(accuracies) if max(accuracies[index:]) - accuracy <= margin + _SHADE
    )


def _enough_certainty(resampled: Array | None, enough: int, margin: float) -> float | None:
    if resampled is None or enough == len(resampled) - 1:
        return None
    left = resampled[enough + 1 :].max(axis=0) - resampled[enough]
    return _share(left <= margin + _SHADE)


def _share(claims: NDArray[np.bool_]) -> float:
    return np.count_nonzero(claims) / claims.size
