"""Fit laws of motion to a course: pushes that are held for a while, with readings after each. For reference protocols.

A solution states how fast its state changes, for each structure that it can imagine, and ranges for the constants.
`Laws.fitted` finds the constants of a structure, `Laws.best` the structure that fits best. Everything works on arrays
of trial constants at once, because a step in Python costs the same for one trial as for hundreds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from scenes.protocol import Exchanges, Reading

Array = NDArray[np.float64]
Knobs = Mapping[str, Any]
"""Constants of a law by name: numbers, or arrays with a value for each trial."""
Rates = Callable[[str, Knobs, Any, Array, Array], Array]
"""Time derivative of the state from structure, constants, time, state and controls. All may be arrays of trials."""

_BOUND = 1e4
"""Largest misfit of a reading that counts, in standard deviations: trials may be far off or diverge."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A number that a call carries or returns: part of a force that is held, or a reading."""

    tool: str
    object_id: str
    field: str
    """Argument of the call, or field of its result."""
    axis: int | None = None
    """Index in a vector; None for a single number."""

    def of(self, values: Mapping[str, Any]) -> float:
        """The number in the arguments of a call or in its result."""
        value = values[self.field]
        return float(value if self.axis is None else value[self.axis])


@dataclass(frozen=True, slots=True)
class Course:
    """A record of n legs: what was held during each, and what was read at its end."""

    durations: Array
    """Simulated time of each leg [s]; shape (n,)."""
    controls: Array
    """Forces and torques held during each leg [N, N·m]; shape (n, controls)."""
    readings: Array
    """What was read at the end of each leg; shape (n, readings); NaN where nothing was read."""


def force(object_id: str, axis: int) -> Channel:
    """Component of the force held on an object."""
    return Channel("apply_force", object_id, "force_vector", axis)


def position(object_id: str, axis: int) -> Channel:
    """Coordinate of an object [m]."""
    return Channel("get_position", object_id, "position", axis)


def velocity(object_id: str, axis: int) -> Channel:
    """Component of the velocity of an object [m/s]."""
    return Channel("get_velocity", object_id, "velocity", axis)


def recorded(exchanges: Exchanges, controls: Sequence[Channel], readings: Sequence[Channel]) -> Course:
    """The course that an episode's calls and readings tell of; what was read before the first step is left out."""
    held, durations, forces, values = [0.0] * len(controls), list[float](), list[list[float]](), list[list[float]]()
    for request, result in exchanges:
        if "error" in result or not result:
            continue
        if request.tool == "step":
            durations.append(float(request.arguments["duration"]))
            forces.append(held)
            values.append([np.nan] * len(readings))
        held = _updated(held, controls, request.tool, request.arguments, request.arguments)
        if values:
            values[-1] = _updated(values[-1], readings, request.tool, request.arguments, result)
    return Course(np.array(durations), np.array(forces), np.array(values))


def _updated(
    before: list[float], channels: Sequence[Channel], tool: str, arguments: Mapping[str, Any], source: Reading
) -> list[float]:
    """The numbers of all channels after a call."""
    return [
        channel.of(source) if channel.tool == tool and channel.object_id == arguments.get("object_id") else number
        for channel, number in zip(channels, before, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class Laws:
    """Every law that a solution considers, with what it knows beforehand."""

    rates: Rates
    structures: Mapping[str, Sequence[str]]
    """Names of the constants of each structure."""
    box: Mapping[str, tuple[float, float]]
    """Range of each constant; searched in even ratios if both ends are positive."""
    start: Sequence[float]
    """State at the start of the course; the readings are its first entries."""
    sigma: Sequence[float]
    """Standard deviation of each reading, rounding included."""
    longest_s: float = 0.1
    """Longest step of the integration [s]."""
    starts: int = 300
    """Number of points of the box that are tried."""
    tried: int = 6
    """How many of the best of them are refined."""
    rounds: int = 15
    """Most steps of a refinement."""
    price: float = 4.0
    """What a constant more must gain in chi-square to be believed."""

    def fitted(self, course: Course, structure: str) -> tuple[float, dict[str, float]]:
        """Chi-square and constants of the best fit of a structure: first leg by leg, then of the whole course."""
        names = self.structures[structure]
        starts = np.random.default_rng(0).random((len(names), self.starts))

        def legs(units: Array) -> Array:
            return self._misfits(course, structure, units, by_legs=True)

        def whole(units: Array) -> Array:
            return self._misfits(course, structure, units, by_legs=False)

        order = np.argsort(np.log1p(legs(starts) ** 2).sum(axis=0))[: self.tried]
        found = [refined(legs, starts[:, start], self.rounds) for start in order]
        unit = min(found, key=lambda unit: float((legs(unit[:, None]) ** 2).sum()))
        unit = refined(whole, unit, self.rounds)
        cost = float((whole(unit[:, None]) ** 2).sum())
        return cost, {name: float(value) for name, value in self._knobs(structure, unit).items()}

    def best(self, course: Course) -> tuple[str, dict[str, float]]:
        """The structure that fits best, each constant paid for, and its constants."""
        fits = {structure: self.fitted(course, structure) for structure in self.structures}
        name = min(fits, key=lambda name: fits[name][0] + self.price * len(self.structures[name]))
        return name, fits[name][1]

    def _knobs(self, structure: str, units: Array) -> dict[str, Any]:
        """Constants at points of the unit cube."""
        names = self.structures[structure]
        spans = [self.box[name] for name in names]
        return {
            name: low * (high / low) ** unit if low > 0 else low + (high - low) * unit
            for name, (low, high), unit in zip(names, spans, units, strict=True)
        }

    def _misfits(self, course: Course, structure: str, units: Array, *, by_legs: bool) -> Array:
        """Misfit of every reading in standard deviations, and a weak pull to the middle; a column for each trial."""
        knobs, trials, size = self._knobs(structure, units), units.shape[1], len(self.sigma)
        follow = self._each_leg if by_legs and len(self.start) == size else self._all_legs
        with np.errstate(all="ignore"):
            states = follow(course, structure, knobs, trials, by_legs)
            misfit = (states[:, :size] - course.readings[:, :, None]) / np.array(self.sigma)[:, None]
        unread = np.asarray(np.isnan(course.readings))
        if by_legs:  # a leg that begins at an unknown place says nothing
            lost = np.concatenate([[False], unread[:-1].any(axis=1)])
            unread = unread | lost[:, None]
        misfit = np.where(unread[:, :, None], 0.0, np.clip(np.nan_to_num(misfit, nan=_BOUND), -_BOUND, _BOUND))
        return np.vstack([misfit.reshape(-1, trials), 0.3 * (units - 0.5)])

    def _each_leg(self, course: Course, structure: str, knobs: Knobs, trials: int, _: bool) -> Array:
        """States at the end of each leg, each begun from the readings before it, all legs at once."""
        before = np.cumsum(course.durations) - course.durations
        starts = np.vstack([self.start, course.readings[:-1]]).T[:, :, None] + np.zeros(trials)
        states = self.advanced(
            structure, knobs, before[:, None], starts, course.durations[:, None], course.controls.T[:, :, None]
        )
        return states.transpose(1, 0, 2)

    def _all_legs(self, course: Course, structure: str, knobs: Knobs, trials: int, by_legs: bool) -> Array:
        """States at the end of each leg, one after the other; `by_legs` sets what can be read to its readings."""
        state = np.array(self.start)[:, None] + np.zeros(trials)
        time, states, size = 0.0, list[Array](), len(self.sigma)
        for duration, control, reading in zip(course.durations, course.controls, course.readings, strict=True):
            state = self.advanced(structure, knobs, time, state, duration, control[:, None] + np.zeros(trials))
            time += duration
            states.append(state)
            if by_legs and not np.isnan(reading).any():
                state = np.vstack([reading[:, None] + np.zeros(trials), state[size:]])
        return np.array(states)

    def advanced(self, structure: str, knobs: Knobs, time: Any, state: Array, duration: Any, controls: Array) -> Array:
        """The state after controls were held for a duration, by the Runge-Kutta method of fourth order."""
        count = max(1, int(np.ceil(np.max(duration) / self.longest_s)))
        h = duration / count
        for _ in range(count):
            a = self.rates(structure, knobs, time, state, controls)
            b = self.rates(structure, knobs, time + h / 2, state + h / 2 * a, controls)
            c = self.rates(structure, knobs, time + h / 2, state + h / 2 * b, controls)
            d = self.rates(structure, knobs, time + h, state + h * c, controls)
            state, time = state + h / 6 * (a + 2 * b + 2 * c + d), time + h
        return state


def refined(misfits: Callable[[Array], Array], unit: Array, rounds: int) -> Array:
    """Least squares from a point of the unit cube (Levenberg-Marquardt), with many sizes of a step tried at once.

    `misfits` returns a column for each column of its argument.
    """
    size = len(unit)
    for _ in range(rounds):
        found = misfits(unit[:, None] + 1e-4 * np.column_stack([np.zeros(size), np.eye(size)]))
        slope = (found[:, 1:] - found[:, :1]) / 1e-4
        normal, pull, cost = slope.T @ slope, slope.T @ found[:, 0], found[:, 0] @ found[:, 0]
        dampings = [np.diag(damping * (np.diag(normal) + 1e-6)) for damping in 10.0 ** np.arange(-5, 3)]
        steps = [cast(Array, np.linalg.lstsq(normal + damping, pull, rcond=None)[0]) for damping in dampings]
        trials = np.clip(unit[:, None] - np.column_stack(steps), -0.1, 1.1)
        costs = (misfits(trials) ** 2).sum(axis=0)
        best = int(np.argmin(costs))
        if costs[best] < cost:
            unit = trials[:, best]
        if costs[best] > 0.999 * cost:
            break
    return unit
