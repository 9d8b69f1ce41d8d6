"""Finds simple formulas that compute an answer key from one or two numbers; fits and tests them on different seeds.

Handles numbers only, without access to scenes and calls.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_TINY = 1e-9
"""Smaller numbers count as rounding errors and get no logarithm."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A number agrees with the key within absolute + relative |key|."""

    absolute: float
    relative: float

    def agree(self, values: Array, keys: Array) -> NDArray[np.bool_]:
        """Return which values agree with their answer keys; NaN never does."""
        return np.abs(values - keys) <= self.absolute + self.relative * np.abs(keys)


@dataclass(frozen=True, slots=True)
class Fit:
    """A formula, and the share of seeds at which it agrees with the answer key."""

    formula: str
    fitted: float
    """Share of the seeds on which it was fitted."""
    held_out: float
    """Share of the other seeds."""


def best_formula(features: Array, names: Sequence[str], keys: Array, fitted: int, tolerance: Tolerance) -> Fit:
    """Return the formula that agrees with the answer key at the largest number of fitted seeds.

    The candidates are a constant, a + b x, c xᵖ, c (x y)ᵖ and c (x / y)ᵖ.

    Args:
        features: Numbers that calls returned, (seeds, features); NaN where a call returned none.
        names: Names of the features.
        keys: The answer key of each seed.
        fitted: Number of seeds, from the first on, that are used for fitting.
        tolerance: Tolerance of the answer key.
    """
    use = np.isfinite(features[:fitted]).all(axis=0) & (np.ptp(np.nan_to_num(features[:fitted]), axis=0) > _TINY)
    x, labels = features[:, use], [name for name, used in zip(names, use, strict=True) if used]
    middle = np.full((len(keys), 1), np.median(keys[:fitted]))
    found = _judged(middle, ["constant"], keys, fitted, tolerance)
    if not labels:
        return found
    lines = _lines(x, keys, fitted)
    return max(
        found,
        _judged(lines, [f"a + b·{label}" for label in labels], keys, fitted, tolerance),
        _of_powers(x, labels, keys, fitted, tolerance),
        key=lambda fit: fit.fitted,
    )


def _of_powers(x: Array, labels: Sequence[str], keys: Array, fitted: int, tolerance: Tolerance) -> Fit:
    """Return the best power law of one number, or of the product or the ratio of two."""
    sign = np.sign(np.median(keys[:fitted]))
    if not (np.sign(keys[:fitted]) == sign).all() or sign == 0:
        return Fit("none", 0.0, 0.0)
    with np.errstate(all="ignore"):
        logs = np.log(np.abs(x))
        usable = np.abs(x[:fitted]).min(axis=0) > _TINY
        logs, named = logs[:, usable], [label for label, may in zip(labels, usable, strict=True) if may]
        if not named:
            return Fit("none", 0.0, 0.0)
        one, other = np.triu_indices(len(named), 1)
        columns = np.hstack([logs, logs[:, one] + logs[:, other], logs[:, one] - logs[:, other]])
        texts = [
            *(f"c·({name})^p" for name in named),
            *(f"c·({named[a]} · {named[b]})^p" for a, b in zip(one, other, strict=True)),
            *(f"c·({named[a]} / {named[b]})^p" for a, b in zip(one, other, strict=True)),
        ]
        wanted = np.log(np.abs(keys))
        return _judged(sign * np.exp(_lines(columns, wanted, fitted)), texts, keys, fitted, tolerance)


def _lines(x: Array, wanted: Array, fitted: int) -> Array:
    """Fit a line to the first seeds for each column of x, by least squares; returns the values of the lines."""
    centre, level = x[:fitted].mean(axis=0), wanted[:fitted].mean()
    spread = ((x[:fitted] - centre) ** 2).sum(axis=0)
    slope = ((x[:fitted] - centre) * (wanted[:fitted, None] - level)).sum(axis=0) / np.where(spread > 0, spread, np.inf)
    return level + slope * (x - centre)


def _judged(values: Array, texts: Sequence[str], keys: Array, fitted: int, tolerance: Tolerance) -> Fit:
    """Return the column that agrees with the answer key at the largest number of fitted seeds."""
    right = tolerance.agree(values, keys[:, None])
    best = int(np.argmax(right[:fitted].sum(axis=0)))
    return Fit(texts[best], float(right[:fitted, best].mean()), float(right[fitted:, best].mean()))
