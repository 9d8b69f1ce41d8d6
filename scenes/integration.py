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
    for _ in range(count):
        a = rates(time, state)
        b = rates(time + h / 2, state + h / 2 * a)
        c = rates(time + h / 2, state + h / 2 * b)
        d = rates(time + h, state + h * c)
        state, time = state + h / 6 * (a + 2 * b + 2 * c + d), time + h
    return state
