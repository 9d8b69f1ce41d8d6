"""Fits laws of motion to time series of pushes and readings. Used by reference protocols.

A `Course` is a time series of legs: intervals with constant pushes, and readings at the end of each. A solution defines
the time derivative of the state for each candidate structure, and ranges for the constants. `Laws.fitted` finds the
constants of a structure, and `Laws.best` the structure with the best fit. All functions are vectorised over trial
constants, because a Python step takes as long for one trial as for hundreds.

A `Predictor` computes the answer from the readings. The names of `scenes.course_record` are also exported from here,
because packs import them from here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from scenes.course_record import Channel, Course, accepted, force, position, recorded, velocity
from scenes.fitting import Array, advanced, chi_square, polished, refined
from scenes.protocol import AnswerValue, Exchanges

__all__ = [
    "PLAIN",
    "Array",
    "Channel",
    "Course",
    "Fitter",
    "Knobs",
    "Laws",
    "Predictor",
    "Rates",
    "accepted",
    "force",
    "position",
    "recorded",
    "refined",
    "velocity",
]

Knobs = Mapping[str, Any]
"""Constants of a law by name: numbers, or arrays with a value for each trial."""
Rates = Callable[[str, Knobs, Any, Array, Array], Array]
"""Function of structure, constants, time, state and controls; returns the time derivative of the state. All arguments
but the structure may be arrays of trials."""

PLAIN = "plain"
"""Name of the simplified law that is used for planning but never for an answer."""
_DEVIATIONS = 4.0
"""A fit explains its course if chi-square exceeds its expected value by at most this many standard deviations."""
_NEARLY = 100.0
"""Chi-square per reading below which a fit is refined with shorter integration steps."""
_FINER, _LAST_ROUNDS = 4, 4
"""Number by which an integration step is divided for the refinement, and largest number of refining iterations."""
_SEARCHES = 4
"""Largest number of searches for a fit that explains a course."""
_IN_VAIN = 0.8
"""A further search follows only if the last one reduced chi-square to less than this fraction."""
_PARTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Fractions of a course to which a repeated search is fitted one after the other."""
_BOUND = 1e4
"""Largest misfit of a reading, in standard deviations; larger ones are clipped because trials may diverge."""


@dataclass(frozen=True, slots=True)
class Laws:
    """The candidate laws of a solution, with the ranges of their constants and the settings of their fits."""

    rates: Rates
    structures: Mapping[str, Sequence[str]]
    """Names of the constants of each structure."""
    box: Mapping[str, tuple[float, float]]
    """Range of each constant; searched on a logarithmic scale if its lower end is positive."""
    start: Sequence[float]
    """State at the start of the course; its first entries are the quantities that are read."""
    sigma: Sequence[float]
    """Standard deviation of each reading, rounding included."""
    longest_s: float = 0.1
    """Longest step of the integration [s]."""
    starts: int = 300
    """Number of random points of the box from which the search starts."""
    tried: int = 6
    """Number of the best of these points that are refined."""
    rounds: int = 15
    """Largest number of iterations of a refinement."""
    hopeless: float = np.inf
    """Largest ratio of the chi-square of a fit leg by leg to that of the best structure. A structure beyond it is not
    fitted to the whole course, because that fit takes most of the time."""
    price: float = 4.0
    """Penalty in chi-square for each constant."""
    plain: Sequence[str] = ()
    """Constants of `PLAIN`, the simplified law for planning, unless a structure has this name."""

    def fitted(self, course: Course, structure: str, search: int = 0) -> tuple[float, dict[str, float]]:
        """Fit a structure leg by leg, then to all legs in sequence; returns chi-square and constants of the best fit.

        `search` is the number of the random search. Later searches use other and more starting points, and fit growing
        parts of the time series, because the fit of a long one has many local minima.
        """
        return self._by_course(course, structure, self._by_legs(course, structure, search), search)

    def _by_legs(self, course: Course, structure: str, search: int) -> list[Array]:
        """Return fits of a structure leg by leg from several starting points, the best first."""
        starts = np.random.default_rng(search).random((len(self.names(structure)), self.starts * (1 + search)))

        def legs(units: Array) -> Array:
            return self.misfits(course, structure, units, by_legs=True)

        order = np.argsort(np.log1p(legs(starts) ** 2).sum(axis=0))[: self.tried * (1 + search)]
        return sorted(
            (refined(legs, starts[:, start], self.rounds) for start in order),
            key=lambda unit: chi_square(legs, unit),
        )

    def _by_course(
        self, course: Course, structure: str, found: Sequence[Array], search: int
    ) -> tuple[float, dict[str, float]]:
        """Fit all legs in sequence, starting from fits leg by leg; returns chi-square and constants of the best fit."""

        def whole(units: Array) -> Array:
            return self.misfits(course, structure, units, by_legs=False)

        parts = _PARTS if search else (1.0,)
        trials = [self._followed(course, structure, start, parts) for start in found[: 1 + search]]
        unit = min(trials, key=lambda trial: chi_square(whole, trial))
        cost = chi_square(whole, unit)
        if cost < _NEARLY * course.count:
            if cost > self.explained(course):
                unit = polished(whole, unit)
            finer = replace(self, longest_s=self.longest_s / _FINER)

            def fine(units: Array) -> Array:
                return finer.misfits(course, structure, units, by_legs=False)

            unit = refined(fine, unit, _LAST_ROUNDS)
            cost = chi_square(fine, unit)
        return cost, {name: float(value) for name, value in self.constants(structure, unit).items()}

    def _followed(self, course: Course, structure: str, unit: Array, parts: Sequence[float]) -> Array:
        """Fit growing parts of the time series (fractions of its legs), each from the result of the previous fit."""
        for share in parts:
            part = course.first(max(1, round(share * len(course.durations))))

            def misfits(units: Array, part: Course = part) -> Array:
                return self.misfits(part, structure, units, by_legs=False)

            unit = refined(misfits, unit, self.rounds)
        return unit

    def best(self, course: Course) -> tuple[str, dict[str, float]]:
        """Return the structure with the best fit, and its constants. Each fitted constant costs a penalty."""
        return self.cheapest(self.fits(course))

    def fits(self, course: Course) -> dict[str, tuple[float, dict[str, float]]]:
        """Return chi-square and constants of the best fit of every structure.

        The search is repeated from other starting points while no structure explains the readings and the fit improves.
        """
        fits = self._searched(course, 0)
        for search in range(1, _SEARCHES):
            before = min(cost for cost, _ in fits.values())
            if before < self.explained(course):
                break
            again = self._searched(course, search)
            fits = {name: min(fits[name], again[name], key=lambda fit: fit[0]) for name in fits}
            # No search can fit a course that none of the laws produced, for example one during which a catch acted.
            if min(cost for cost, _ in fits.values()) > _IN_VAIN * before:
                break
        return fits

    def _searched(self, course: Course, search: int) -> dict[str, tuple[float, dict[str, float]]]:
        """Search once for each structure; returns chi-square (infinite beyond `hopeless`) and constants."""
        found = {structure: self._by_legs(course, structure, search) for structure in self.structures}
        costs = {
            structure: chi_square(lambda units, by=structure: self.misfits(course, by, units, by_legs=True), units[0])
            for structure, units in found.items()
        }
        least = min(costs.values())
        return {
            structure: self._by_course(course, structure, units, search)
            if costs[structure] <= self.hopeless * least
            else (np.inf, {name: float(value) for name, value in self.constants(structure, units[0]).items()})
            for structure, units in found.items()
        }

    @staticmethod
    def explained(course: Course) -> float:
        """Return the largest chi-square at which a fit counts as an explanation of the readings."""
        return course.count + _DEVIATIONS * float(np.sqrt(2 * course.count))

    def cheapest(self, fits: Mapping[str, tuple[float, dict[str, float]]]) -> tuple[str, dict[str, float]]:
        """Return the best fit by chi-square with a penalty for each fitted constant."""
        name = min(fits, key=lambda name: fits[name][0] + self.price * len(self.names(name)))
        return name, fits[name][1]

    def names(self, structure: str) -> Sequence[str]:
        """Names of the constants of a structure, or of the simplified law `PLAIN`."""
        return self.plain if structure == PLAIN and PLAIN not in self.structures else self.structures[structure]

    def constants(self, structure: str, units: Array) -> dict[str, Any]:
        """Convert points of the unit cube to constants."""
        names = self.names(structure)
        spans = [self.box[name] for name in names]
        return {
            name: low * (high / low) ** unit if low > 0 else low + (high - low) * unit
            for name, (low, high), unit in zip(names, spans, units, strict=True)
        }

    def misfits(
        self, course: Course, structure: str, units: Array, *, by_legs: bool, spread: float = 1.0, pull: float = 0.3
    ) -> Array:
        """Compute the misfits between the readings and those predicted with trial constants.

        Args:
            course: Controls and readings.
            structure: A structure, or `PLAIN`.
            units: Points of the unit cube; a column for each trial.
            by_legs: Whether each leg is integrated from the readings before it.
            spread: Factor of the standard deviations.
            pull: Weight of a regularisation towards the middle of the unit cube, for constants that the readings do
                not determine.

        Returns:
            Misfit of every reading in standard deviations, then the regularisation terms; a column for each trial.
        """
        knobs, trials, size = self.constants(structure, units), units.shape[1], len(self.sigma)
        follow = self._each_leg if by_legs and len(self.start) == size else self._all_legs
        with np.errstate(all="ignore"):
            states = follow(course, structure, knobs, trials, by_legs)
            misfit = (states[:, :size] - course.readings[:, :, None]) / (spread * np.array(self.sigma)[:, None])
        unread = np.asarray(np.isnan(course.readings))
        if by_legs:  # a leg that starts at an unread position cannot be predicted
            lost = np.concatenate([[False], unread[:-1].any(axis=1)])
            unread = unread | lost[:, None]
        misfit = np.where(unread[:, :, None], 0.0, np.clip(np.nan_to_num(misfit, nan=_BOUND), -_BOUND, _BOUND))
        return np.vstack([misfit.reshape(-1, trials), pull * (units - 0.5)])

    def _each_leg(self, course: Course, structure: str, knobs: Knobs, trials: int, _: bool) -> Array:
        """Integrate all legs at once, each from the readings before it; returns the states at their ends."""
        before = np.cumsum(course.durations) - course.durations
        starts = np.vstack([self.start, course.readings[:-1]]).T[:, :, None] + np.zeros(trials)
        states = self.advanced(
            structure, knobs, before[:, None], starts, course.durations[:, None], course.controls.T[:, :, None]
        )
        return states.transpose(1, 0, 2)

    def _all_legs(self, course: Course, structure: str, knobs: Knobs, trials: int, by_legs: bool) -> Array:
        """Integrate the legs in sequence; returns the state after each. `by_legs` starts each leg from its readings."""
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
        """Return the state after constant controls for a duration."""

        def rates(at: Any, now: Array) -> Array:
            return self.rates(structure, knobs, at, now, controls)

        return advanced(rates, time, state, duration, self.longest_s)


class Fitter(Protocol):
    """Interface of the classes that fit structures to a `Course`, such as `Laws`."""

    def fitted(self, course: Course, structure: str) -> tuple[float, dict[str, float]]:
        """Return chi-square and constants of the best fit of a structure."""
        ...

    def best(self, course: Course) -> tuple[str, dict[str, float]]:
        """Return the structure that fits best, and its constants."""
        ...


@dataclass(frozen=True, slots=True)
class Predictor:
    """Computes the answer from the readings, by fitting laws."""

    laws: Fitter | Callable[[Course], Fitter]
    """The laws; or a function of the course, if their ranges depend on the readings."""
    course: Callable[[Exchanges], Course]
    """Extracts the course from the exchanges, without the parts that must not be fitted."""
    predict: Callable[[str, Mapping[str, Any]], AnswerValue]
    """Computes the answer from a structure and its constants."""

    def fit(self, readings: Exchanges, structure: str) -> AnswerValue:
        """Return the answer of the best fit of a structure."""
        course = self.course(readings)
        return self.predict(structure, self._laws(course).fitted(course, structure)[1])

    def best(self, readings: Exchanges) -> AnswerValue:
        """Return the answer of the structure with the best fit."""
        course = self.course(readings)
        return self.predict(*self._laws(course).best(course))

    def _laws(self, course: Course) -> Fitter:
        return self.laws(course) if callable(self.laws) else self.laws
