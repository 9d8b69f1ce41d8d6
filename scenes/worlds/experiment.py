"""Experiments in a world: the choice of pushes, the simulated readings, and fits of a structure to them.

`Excitation` chooses pushes from readings only. The reference therefore makes the same pushes in the laboratory as the
certificate makes in its simulation of the theory.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from scenes.course_record import Course
from scenes.courses import Laws
from scenes.fitting import Array
from scenes.worlds.drawing import searched
from scenes.worlds.equations import followed, rates_of
from scenes.worlds.instrument_errors import error_columns, error_names, whitened
from scenes.worlds.parts import Apparatus
from scenes.worlds.terms import Structure

LOOK_S, LOOKS = 0.45, 2
"""Laboratory time between two readings [s], and number of readings in a leg. Pushes are constant during a leg."""
RESOLUTION = 0.001
"""Resolution of positions and velocities [m, rad, m/s, rad/s]."""
SEARCH_S = 0.09
"""Longest integration step of a fit [s]."""
COURSE_S = 0.03
"""Longest integration step of a simulated course [s]."""
TURNS = 18
"""Largest number of iterations of a course."""
_FAR = 1e9
"""Misfit that stands for a non-finite one, for example after divergence [standard deviations]."""
_SLOWED = 0.6
"""Expected share of its velocity that a body keeps in a leg whose end is not read before the next one."""
_REACH = 0.7
"""Share of the radius within which targets lie."""
_LINE_REACH = 3.0
"""Farthest target of a wheel [rad]."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The information in the prompt: the apparatus, its limits and its instruments."""

    apparatus: Apparatus
    radius: float
    """Distance at which the wall or the buffers begin [m]; unused for a wheel."""
    force: float
    """Largest force on a body [N], or torque on a wheel [N·m]."""
    looks: int
    """Number of readings that the calls and the time allow."""
    noise: float
    """Standard deviation of positions [m, rad]; the number for velocities is twice as large [m/s, rad/s]."""
    bias: float = 0.0
    """Largest error of the position instrument at time 0 [m, rad]; see `scenes.worlds.instrument_errors`."""
    drift: float = 0.0
    """Largest change of the error per second [m/s, rad/s]."""

    @property
    def sigma(self) -> Array:
        """Standard deviation of each reading, rounding included."""
        return np.hypot(self.noises, RESOLUTION / math.sqrt(12))

    @property
    def noises(self) -> Array:
        """Standard deviation of the noise of each reading."""
        return np.tile(np.repeat([self.noise, 2 * self.noise], self.width), self.bodies)

    @property
    def errors(self) -> tuple[str, ...]:
        """Names of the constants that are errors of the position instrument; none if the prompt states no error."""
        return error_names(self.width) if self.bias or self.drift else ()

    def errors_at(self, constants: Mapping[str, float], times: Array) -> Array:
        """Return the systematic error of each reading at times [s]; shape (times, readings)."""
        values = np.array([constants[name] for name in self.errors])
        return error_columns(times, self.bodies, self.width)[:, :, : len(values)] @ values

    def spread(self, durations: Array) -> Array:
        """Return the systematic error of readings for errors of the size of their bounds; (readings, errors)."""
        if not self.errors:
            return np.zeros((len(durations) * len(self.sigma), 0))
        columns = error_columns(np.cumsum(durations), self.bodies, self.width)
        return (columns * np.repeat([self.bias, self.drift], self.width)).reshape(-1, columns.shape[2])

    def whitened(self, misfits: Array, course: Course) -> Array:
        """Eliminate the errors of the position instrument from misfits of readings.

        Args:
            misfits: Misfits in standard deviations, a column for each trial; further rows are kept.
            course: The readings. Those that are NaN have no error.
        """
        if not self.errors:
            return misfits
        count = course.readings.size
        spread = self.spread(course.durations) / np.tile(self.sigma, len(course.durations))[:, None]
        spread[np.isnan(course.readings.ravel())] = 0.0
        return np.vstack([whitened(misfits[:count], spread), misfits[count:]])

    @property
    def width(self) -> int:
        """Number of components of a position."""
        return 2 if self.apparatus.flat else 1

    @property
    def bodies(self) -> int:
        """Number of bodies that can be pushed."""
        return 2 if self.apparatus is Apparatus.PAIR else 1

    @property
    def legs(self) -> int:
        """Number of legs of a course."""
        return self.looks // LOOKS

    @property
    def turns(self) -> tuple[int, ...]:
        """Number of legs in each iteration. They are planned together, because an episode has few iterations."""
        size = -(-self.legs // TURNS)
        return tuple(min(size, self.legs - begun) for begun in range(0, self.legs, size))


@dataclass(slots=True)
class Excitation:
    """Pushes each body towards random targets with forces of many sizes, and sometimes lets it coast."""

    situation: Situation
    seed: int = 1
    _rng: np.random.Generator = field(init=False)
    _leads: list["_Lead"] = field(init=False)
    _leg: int = 0

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._leads = [_Lead() for _ in range(self.situation.bodies)]

    def pushes(self, read: Array, legs: int) -> list[Array]:
        """Return the pushes of the next legs [N, N·m], from the last reading of each state."""
        told, width = self.situation, 2 if self.situation.apparatus.flat else 1
        expected, found = read.reshape(told.bodies, 2, width).copy(), list[Array]()
        for _ in range(legs):
            coasts = self._leg % 7 == 5
            self._leg += 1
            parts: list[Array] = []
            for lead, (place, speed) in zip(self._leads, expected, strict=True):
                want = lead.towards(place, speed, self._reach, self._rng)
                free = coasts and float(np.linalg.norm(place)) < 0.7 * self._reach
                parts.append(np.zeros(width) if free else told.force * want)
            found.append(np.round(np.concatenate(parts), 3))
            expected[:, 1] *= _SLOWED
            expected[:, 0] += LOOKS * LOOK_S * expected[:, 1]
        return found

    @property
    def _reach(self) -> float:
        return _LINE_REACH if self.situation.apparatus is Apparatus.WHEEL else _REACH * self.situation.radius


@dataclass(slots=True)
class _Lead:
    """The random target towards which a body is pushed, and the gain of the push."""

    target: Array | None = None
    gain: float = 0.0
    legs: int = 0

    def towards(self, place: Array, speed: Array, reach: float, rng: np.random.Generator) -> Array:
        """Return the push towards the target, relative to the largest push."""
        if self.target is None or self.legs > 2 or float(np.linalg.norm(self.target - place)) < 0.15 * reach:
            turn = rng.uniform(0, 2 * math.pi)
            way = np.array([math.cos(turn), math.sin(turn)][: len(place)])
            self.target = reach * math.sqrt(rng.uniform(0.02, 1)) * (way if len(place) == 2 else np.sign(way))
            self.gain, self.legs = rng.uniform(0.15, 0.5), 0
        self.legs += 1
        want = self.gain * (self.target - place) - 0.25 * speed
        return want * min(1.0, 0.98 / max(1e-9, float(np.linalg.norm(want))))


def simulated(
    structure: Structure,
    constants: Mapping[str, float],
    told: Situation,
    noise_seed: int | None,
    longest_s: float = COURSE_S,
) -> Course:
    """Simulate an experiment by integrating the equations of motion, without MuJoCo; returns its pushes and readings.

    Args:
        structure: The terms of the law.
        constants: Their constants, and the errors of the position instrument if it has any.
        told: Limits and instruments.
        noise_seed: Seed of the instrument noise; readings are then rounded, too. None for exact readings.
        longest_s: Longest step of the integration [s].
    """
    rng = None if noise_seed is None else np.random.default_rng(noise_seed)
    plan, rates = Excitation(told), rates_of(structure, walled=True, single=True)
    state, time, sigma = list(structure.start), 0.0, told.noises
    read = np.array(state[: structure.read])
    held, seen = list[Array](), list[Array]()
    for legs in told.turns:
        for pushes in plan.pushes(read, legs):
            for _ in range(LOOKS):
                state = followed(rates, constants, time, state, pushes.tolist(), LOOK_S, longest_s)
                time += LOOK_S
                read = np.array(state[: structure.read])
                if told.errors:
                    read = read + told.errors_at(constants, np.array([time]))[0]
                if rng is not None:
                    read = np.round((read + sigma * rng.normal(size=len(read))) / RESOLUTION) * RESOLUTION
                held.append(pushes)
                seen.append(read)
    return Course(np.full(len(seen), LOOK_S), np.array(held), np.array(seen))


def retraced(
    structure: Structure, constants: Mapping[str, float], told: Situation, course: Course, longest_s: float = SEARCH_S
) -> Array:
    """Return the whitened differences of readings and theory under the same pushes [standard deviations].

    Args:
        structure: The terms of the law.
        constants: Their constants.
        told: The instruments.
        course: Pushes and readings.
        longest_s: Longest step of the integration [s].

    Returns:
        The same shape as the readings.
    """
    seen = traced(structure, constants, course.durations, course.controls, longest_s)
    found = np.nan_to_num((seen - course.readings) / told.sigma, nan=_FAR, posinf=_FAR, neginf=-_FAR)
    return told.whitened(found.reshape(-1, 1), course).reshape(found.shape)


def traced(
    structure: Structure, constants: Mapping[str, float], durations: Array, controls: Array, longest_s: float
) -> Array:
    """Integrate the equations of motion under given pushes; returns the readable state after each leg.

    Args:
        structure: The terms of the law.
        constants: Their constants.
        durations: Time of each leg [s].
        controls: Pushes during each leg [N, N·m]; shape (legs, controls).
        longest_s: Longest step of the integration [s].
    """
    rates, state, time = rates_of(structure, walled=True, single=True), list(structure.start), 0.0
    seen = list[list[float]]()
    for lasting, held in zip(durations.tolist(), controls.tolist(), strict=True):
        state = followed(rates, constants, time, state, held, lasting, longest_s)
        time += lasting
        seen.append(state[: structure.read])
    return np.array(seen)


@functools.lru_cache(1024)
def laws_of_fit(structure: Structure, told: Situation, longest_s: float = SEARCH_S) -> Laws:
    """Return the `Laws` that fit a structure to pushes and readings of this apparatus."""
    rates = rates_of(structure, walled=True)

    def of_course(_structure: str, knobs: Mapping[str, Any], time: Any, state: Array, controls: Array) -> Array:
        return rates(knobs, controls)(time, state)

    return Laws(
        rates=of_course,
        structures={structure.label: tuple(structure.ranges)},
        box={name: searched(bounds) for name, bounds in structure.ranges.items()},
        start=structure.start,
        sigma=tuple(told.sigma),
        longest_s=longest_s,
    )


def course_misfits(structure: Structure, told: Situation, laws: Laws, course: Course, units: Array) -> Array:
    """Return the whitened misfits of all legs in sequence, then the regularisation terms; a column for each trial."""
    return told.whitened(laws.misfits(course, structure.label, units, by_legs=False), course)


def on_unit(laws: Laws, constants: Mapping[str, float]) -> Array:
    """Return the point of the unit cube at which the constants have these values."""
    found: list[float] = []
    for name in next(iter(laws.structures.values())):
        low, high = laws.box[name]
        value = constants[name]
        share = math.log(max(value, 1e-9) / low) / math.log(high / low) if low > 0 else (value - low) / (high - low)
        found.append(share)
    return np.array(found)
