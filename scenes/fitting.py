"""Least squares on the unit cube and Runge-Kutta steps, vectorised over trial points. Used by reference protocols."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
Misfits = Callable[[Array], Array]
"""Function of points of the unit cube, one per column, that returns misfits in standard deviations, one column per
point."""

_EDGES = (-0.1, 1.1)
"""Bounds of a constant in units of its range: slightly outside it."""
_SHIFT = 1e-4
"""Step of finite differences, in units of the range."""
_STEPS = 30
"""Largest number of iterations of `polished`."""


def chi_square(misfits: Misfits, unit: Array) -> float:
    """Return the sum of the squared misfits at a point."""
    return float((misfits(unit[:, None]) ** 2).sum())


def refined(misfits: Misfits, unit: Array, rounds: int) -> Array:
    """Run Levenberg-Marquardt from a point of the unit cube, trying several damping factors at once.

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
    """Run the least squares of SciPy, for narrow valleys in which `refined` stops before the minimum."""

    def slope(point: Array) -> Array:
        found = misfits(point[:, None] + _shifts(len(point)))
        return (found[:, 1:] - found[:, :1]) / _SHIFT

    inside = np.clip(unit, _EDGES[0] + _SHIFT, _EDGES[1] - _SHIFT)
    return least_squares(
        lambda point: misfits(point[:, None])[:, 0], inside, jac=slope, bounds=_EDGES, max_nfev=_STEPS
    ).x


def _shifts(size: int) -> Array:
    """Return offsets for finite differences: a column of zeros, then one with a small step in each coordinate."""
    return _SHIFT * np.column_stack([np.zeros(size), np.eye(size)])


Array = NDArray[np.float64]


def advanced(rates: Callable[[Any, Array], Array], time: Any, state: Array, duration: Any, longest_s: float) -> Array:
    """Return the state after a duration, by the fourth-order Runge-Kutta method.

    Args:
        rates: Time derivative of the state from time and state.
        time: Initial time [s]; a number, or an array of trials.
        state: Initial state; shape (states, trials).
        duration: Duration [s]; a number, or an array of trials.
        longest_s: Longest step [s].
    """
    count = max(1, int(np.ceil(np.max(duration) / longest_s)))
    h = duration / count
    half, sixth = h / 2, h / 6
    for _ in range(count):
        a = rates(time, state)
        b = rates(time + half, state + half * a)
        c = rates(time + half, state + half * b)
        time = time + h
        d = rates(time, state + h * c)
        change = 2 * b  # then in place: the arrays that `rates` returned may be in use elsewhere
        change += a
        change += 2 * c
        change += d
        change *= sixth
        state = state + change
    return state
