"""Least squares on the unit cube, vectorised over trial points. For reference protocols."""

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
Misfits = Callable[[Array], Array]
"""Misfits in standard deviations of trials: a column for each column of its argument, a point of the unit cube."""

_EDGES = (-0.1, 1.1)
"""Bounds of a constant on the unit of its range: a little beyond it."""
_SHIFT = 1e-4
"""Step of finite differences, in the same unit."""
_STEPS = 30
"""Most steps of `polished`."""


def chi_square(misfits: Misfits, unit: Array) -> float:
    """Sum of the squared misfits at a point."""
    return float((misfits(unit[:, None]) ** 2).sum())


def refined(misfits: Misfits, unit: Array, rounds: int) -> Array:
    """Levenberg-Marquardt from a point of the unit cube, with several damping factors tried at once.

    `misfits` returns a column for each column of its argument.
    """
    size = len(unit)
    for _ in range(rounds):
        found = misfits(unit[:, None] + _shifts(size))
        slope = (found[:, 1:] - found[:, :1]) / _SHIFT
        normal, pull, cost = slope.T @ slope, slope.T @ found[:, 0], found[:, 0] @ found[:, 0]
        dampings = [np.diag(damping * (np.diag(normal) + 1e-6)) for damping in 10.0 ** np.arange(-5, 3)]
        steps = [cast(Array, np.linalg.lstsq(normal + damping, pull, rcond=None)[0]) for damping in dampings]
        trials = np.clip(unit[:, None] - np.column_stack(steps), *_EDGES)
        costs = (misfits(trials) ** 2).sum(axis=0)
        best = int(np.argmin(costs))
        if costs[best] < cost:
            unit = trials[:, best]
        if costs[best] > 0.999 * cost:
            break
    return unit


def polished(misfits: Misfits, unit: Array) -> Array:
    """Least squares with scipy, for narrow valleys in which `refined` stops before the minimum."""

    def slope(point: Array) -> Array:
        found = misfits(point[:, None] + _shifts(len(point)))
        return (found[:, 1:] - found[:, :1]) / _SHIFT

    inside = np.clip(unit, _EDGES[0] + _SHIFT, _EDGES[1] - _SHIFT)
    return least_squares(
        lambda point: misfits(point[:, None])[:, 0], inside, jac=slope, bounds=_EDGES, max_nfev=_STEPS
    ).x


def _shifts(size: int) -> Array:
    """Offsets for finite differences: a column of zeros, then one with a small step in each coordinate."""
    return _SHIFT * np.column_stack([np.zeros(size), np.eye(size)])
