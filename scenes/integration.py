"""Integrates equations of motion for many trials at once."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
