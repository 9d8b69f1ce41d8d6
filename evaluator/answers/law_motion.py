"""Integrates the motion of objects under a law that is given as text, in fixed time steps. `laws` grades such laws.

A simulation consists of *legs*, during which the loads are constant.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from physment_mcp.contract.stated_laws import PLACES, SPEEDS, StatedLaw
from scenes.law_statements import Coordinate

_LEG_S, _LOOKS = 1.5, 6
"""Duration of a leg [s], and number of states of a leg that are compared between laws."""
LEG_STEPS = 150
"""Number of integration steps of a leg; a multiple of the number of compared states."""
_HELD_STEP_S = 0.05
"""Largest integration step of the law's state variables while the objects are held [s]."""


@dataclass(frozen=True, slots=True)
class LoadPlan:
    """Input of a simulation: the initial state and, for each leg, one load per coordinate."""

    held_s: float
    """Time for which the objects are held at the start [s]."""
    places: list[float]
    speeds: list[float]
    loads: list[list[float]]


@dataclass
class StatedMotion:
    """The equations of motion of the objects under a law."""

    law: StatedLaw
    coordinates: Sequence[Coordinate]

    def __post_init__(self) -> None:
        at, found = self.law.arguments.index, self.law.components
        axes = [(one.body, one.axis, dict(zip(PLACES, SPEEDS, strict=True))[one.axis]) for one in self.coordinates]
        self._places = [at(f"{body}_{axis}") for body, axis, _ in axes]
        self._speeds = [at(f"{body}_{speed}") for body, _, speed in axes]
        self._loads = [at(f"{body}_{'turn_z' if axis == 'angle' else f'push_{axis}'}") for body, axis, _ in axes]
        self._results = [found.index((body, axis)) if (body, axis) in found else None for body, axis, _ in axes]
        self._count, self._first = len(axes), len(self.law.arguments) - len(self.law.states)
        self.start = list(self.law.states.values())

    def rates(
        self, time: float, seen: Sequence[float], states: Sequence[float], loads: Sequence[float]
    ) -> tuple[list[float], list[float]]:
        """Return the accelerations, and the time derivatives of the law's state variables.

        Args:
            time: Time since the start [s].
            seen: Positions, then velocities.
            states: Values of the state variables.
            loads: Forces and torques.

        Raises:
            ArithmeticError: The law has no value there.
            ValueError: As for ArithmeticError.
        """
        values = [0.0] * len(self.law.arguments)
        values[0], values[self._first :] = time, states
        for n in range(self._count):
            values[self._places[n]], values[self._speeds[n]] = seen[n], seen[self._count + n]
            values[self._loads[n]] = loads[n]
        found = self.law.rates(*values)
        return [0.0 if at is None else found[at] for at in self._results], list(found[len(self.law.components) :])

    def clamped(self, seen: Sequence[float], lasting: float) -> list[float]:
        """Return the law's state variables after the objects were clamped for a time [s]."""
        states, none = list(self.start), [0.0] * self._count
        if not states or not lasting:
            return states
        count = held_steps(lasting)
        h = lasting / count

        def slope(time: float, now: list[float]) -> list[float]:
            return self.rates(time, seen, now, none)[1]

        for number in range(count):
            states = _advanced(slope, number * h, states, h)
        return states

    def followed(self, course: LoadPlan) -> list[list[float]] | None:
        """Simulate a plan; return positions and velocities at each compared time, or None if they are not finite."""
        time, looks, seen = course.held_s, list[list[float]](), [*course.places, *course.speeds]
        h = _LEG_S / LEG_STEPS
        try:
            whole = seen + self.clamped([*course.places, *[0.0] * self._count], time)
            for loads in course.loads:

                def slope(now: float, y: list[float], loads: Sequence[float] = loads) -> list[float]:
                    split = 2 * self._count
                    accelerations, changes = self.rates(now, y[:split], y[split:], loads)
                    return [*y[self._count : split], *accelerations, *changes]

                for step in range(1, LEG_STEPS + 1):
                    whole = _advanced(slope, time, whole, h)
                    time += h
                    if step * _LOOKS % LEG_STEPS == 0:
                        looks.append(whole[: 2 * self._count])
        except (ArithmeticError, ValueError):
            return None
        return looks if all(map(math.isfinite, looks[-1])) else None


def held_steps(lasting: float) -> int:
    """Return the number of integration steps for the time during which the objects are held [s]."""
    return math.ceil(lasting / _HELD_STEP_S)


def _advanced(slope: Callable[[float, list[float]], list[float]], time: float, y: list[float], h: float) -> list[float]:
    """Do one Runge-Kutta step of fourth order."""
    a = slope(time, y)
    b = slope(time + h / 2, [v + h / 2 * k for v, k in zip(y, a, strict=True)])
    c = slope(time + h / 2, [v + h / 2 * k for v, k in zip(y, b, strict=True)])
    d = slope(time + h, [v + h * k for v, k in zip(y, c, strict=True)])
    return [v + h / 6 * (p + 2 * q + 2 * r + s) for v, p, q, r, s in zip(y, a, b, c, d, strict=True)]
