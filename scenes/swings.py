"""Drives a body to increasing swings without reaching a catch, and fits its laws. Used by reference protocols.

A solution defines its controls and readings (`Rig`), its laws, a simplified law for planning, and an objective for
planned paths. `Swing` increases a push until the body moves. Then it repeats: fit the simplified law to all readings so
far, simulate many sequences of pushes, and apply the first pushes of the best sequence (model predictive control).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from scenes.course_record import Course
from scenes.courses import PLAIN, Knobs, Laws, Predictor
from scenes.fitting import Array, Misfits, chi_square, refined
from scenes.protocol import Call, Protocol, answer
from scenes.rigs import Rig

SHARES = (-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0)
"""Candidate sizes of planned pushes, as fractions of the strongest."""
_BEYOND = 1e3
"""Penalty for each unit of distance beyond a limit, at each reading."""
_LOST = 9.0
"""Coordinate that replaces a non-finite one of a diverged path: beyond every reach."""


@dataclass(frozen=True, slots=True)
class LegFit:
    """Fits each leg of a `Course` from the readings before it.

    Such a fit is fast and independent of the initial state, so it also works for bodies in unstable equilibrium. A fit
    of all legs in sequence is more precise.
    """

    laws: Laws
    spread: float = 2.0
    """Factor of the standard deviations: the readings before a leg have errors, too."""
    pull: float = 1.0
    """Weight of the regularisation towards the middle of the ranges."""
    starts: int = 400
    """Number of points of the unit cube that are tried if no fit is known."""
    tried: int = 1
    """Number of the best of these points that are refined."""
    rounds: int = 12
    """Largest number of iterations of these refinements."""
    again: int = 6
    """Largest number of iterations of the last refinement, from the best point or the known fit."""

    def unit(self, course: Course, structure: str, known: Array | None = None) -> Array:
        """Return the fitted constants as a point of the unit cube; `known` is such a point from a fit of fewer legs."""
        misfits = self._misfits(course, structure)
        if known is None:
            units = np.random.default_rng(1).random((len(self.laws.names(structure)), self.starts))
            order = np.argsort(np.log1p(misfits(units) ** 2).sum(axis=0))[: self.tried]
            found = [refined(misfits, units[:, start], self.rounds) for start in order]
            known = min(found, key=lambda unit: chi_square(misfits, unit))
        return refined(misfits, known, self.again)

    def fitted(self, course: Course, structure: str) -> tuple[float, dict[str, float]]:
        """Return chi-square and constants of the best fit, refined by `polished`."""
        misfits, start = self._misfits(course, structure), self.unit(course, structure)
        unit = least_squares(lambda point: misfits(point[:, None])[:, 0], start, method="lm", max_nfev=150).x
        constants = self.laws.constants(structure, unit)
        return chi_square(misfits, unit), {name: float(value) for name, value in constants.items()}

    def best(self, course: Course) -> tuple[str, dict[str, float]]:
        """Return the structure with the best fit, and its constants. Each fitted constant costs a penalty."""
        return self.laws.cheapest({name: self.fitted(course, name) for name in self.laws.structures})

    def plausible(self, course: Course, more: float) -> list[tuple[str, Knobs]]:
        """Return the structures that the readings do not exclude, each with its best-fit constants.

        Args:
            course: Pushes and readings.
            more: Largest chi-square of a plausible structure, above that of the best one.
        """
        units = {name: self.unit(course, name) for name in self.laws.structures}
        costs = {name: chi_square(self._misfits(course, name), unit) for name, unit in units.items()}
        largest = min(costs.values()) + more
        return [(name, self.laws.constants(name, unit)) for name, unit in units.items() if costs[name] <= largest]

    def _misfits(self, course: Course, structure: str) -> Misfits:
        return lambda units: self.laws.misfits(
            course, structure, units, by_legs=True, spread=self.spread, pull=self.pull
        )


@dataclass(frozen=True, slots=True)
class SwingPlan:
    """The state and the objective before the next legs."""

    knobs: Knobs
    """Constants of the simplified law."""
    course: Course
    """The course so far."""
    span: float
    """Duration of a leg [s]."""
    reach: float
    """Largest distance that the body may reach."""
    side: int
    """1 or -1: the side to which a wide swing is wanted."""
    look: float
    """Time between the readings of a path [s]."""


def to_and_fro(rng: np.random.Generator, legs: int, trials: int, shares: Sequence[float] = SHARES) -> Array:
    """Return random pushes of one control, relative to the strongest; shape (legs, 1, trials)."""
    return rng.choice(shares, (legs, trials))[:, None, :]


def to_a_side(plan: SwingPlan, place: Array, far: float, more: Array) -> Array:
    """Return the objective of planned paths with wide swings to one side, within the reach.

    Args:
        plan: State of the body and objective.
        place: Coordinate at each reading of each trial; shape (looks, trials).
        far: Distance beyond which a swing counts as wide.
        more: Additional value of a reading; shape (looks, trials).

    Returns:
        For each trial, the sum over readings of 10 max(min(side x, reach) - far, 0) + more - 1000 max(|x| - reach, 0).
    """
    wide = 10 * np.maximum(np.minimum(plan.side * place, plan.reach) - far, 0.0)
    return (wide + more - _BEYOND * np.maximum(abs(place) - plan.reach, 0.0)).sum(axis=0)


def _coasts(_: Course) -> Sequence[tuple[float, float]]:
    return ((0.0, 0.2), (0.0, 0.2))


def _none(_: Course) -> Sequence[tuple[str, Knobs]]:
    return ()


@dataclass(frozen=True, slots=True)
class Swing:
    """Drives the body, fits its laws and predicts the answer."""

    rig: Rig
    model: Predictor
    """The final fit, to the whole course; the first entries of its readings are those of the state."""
    rough: LegFit
    """The fit of the simplified law, with which pushes are planned."""
    touches: Sequence[float]
    """First values of the first control, until the body moves."""
    moved: Callable[[Array], bool]
    """Returns whether a reading shows that the body moves."""
    strongest: Callable[[SwingPlan], float]
    """Largest push of a plan, in the units of the control."""
    worth: Callable[[SwingPlan, Array], Array]
    """Returns the value of each planned path, from the states at its readings; shape (looks, states, trials) to
    (trials,)."""
    span: Callable[[Knobs], float]
    """Returns the duration of a leg [s] from the constants of the simplified law."""
    reaches: Sequence[float]
    """Largest swing in each round; the last value holds for all further rounds."""
    wider: Callable[[Course], float]
    """Returns the largest allowed swing from the course so far: somewhat more than the largest one reached."""
    time_s: float
    """Largest total duration of the planned legs [s]."""
    fixed_pushes: Sequence[Any]
    """Pushes of the fixed batch."""
    fixed_s: float
    """Duration of each push of the fixed batch [s]."""
    touch_s: float = 0.2
    settled: Callable[[Course], Sequence[tuple[float, float]]] = _coasts
    """Pushes and durations after the touches."""
    pattern: Callable[[np.random.Generator, int, int], Array] = field(default=to_and_fro)
    """Returns random pushes as fractions of the strongest; (legs, trials) to shape (legs, controls, trials)."""
    turns_every: int = 2
    """Number of rounds after which the wanted side changes."""
    rounds: int = 14
    """Largest number of rounds."""
    legs: int = 3
    """Number of legs that are executed in a round."""
    ahead: int = 5
    """Number of legs that are planned in a round."""
    looks: int = 3
    """Number of readings in each planned leg."""
    trials: int = 300
    """Number of simulated sequences."""
    calls: int = 148
    """Largest number of calls before the answer."""
    plausible: Callable[[Course], Sequence[tuple[str, Knobs]]] = _none
    """Returns structures and constants that the course so far does not exclude."""
    limit: float = np.inf
    """Distance within which a planned path should stay by each law of `plausible`, too, not only by the simplified
    law."""

    def solve(self, _: str) -> Protocol:
        """Increase a push until the body moves, then push as planned with the simplified law; fit every law."""
        seen: list[tuple[Call, Any]] = []
        for strength in self.touches:
            calls = self.rig.leg(strength, self.touch_s)
            seen += zip(calls, (yield calls), strict=True)
            if self.moved(self.model.course(seen).readings[-1]):
                break
        settling = self.settled(self.model.course(seen))
        calls = [asked for push, lasting in settling for asked in self.rig.leg(push, lasting)]
        seen += zip(calls, (yield calls), strict=True)
        unit, spent = None, 0.0
        for number in range(self.rounds):
            course = self.model.course(seen)
            unit = self.rough.unit(course, PLAIN, unit)
            knobs = self.rough.laws.constants(PLAIN, unit)
            span = self.span(knobs)
            spent += self.legs * span
            reach = min(self.reaches[min(number, len(self.reaches) - 1)], self.wider(course))
            plan = SwingPlan(knobs, course, span, reach, (-1) ** (number // self.turns_every), span / self.looks)
            calls = [asked for push in self.planned(plan) for asked in self.rig.leg(push, span)]
            if len(seen) + len(calls) > self.calls or spent > self.time_s:
                break
            seen += zip(calls, (yield calls), strict=True)
        yield [answer(self.model.best(seen))]

    def planned(self, plan: SwingPlan) -> Array:
        """Return the pushes of the next legs: the best of many sequences by the objective; shape (legs, controls)."""
        pushes = self.strongest(plan) * self.pattern(np.random.default_rng(2), self.ahead, self.trials)
        worth = self.worth(plan, self._path(plan, pushes, PLAIN, plan.knobs))
        beyond = [self._beyond(self._path(plan, pushes, *law)) for law in self.plausible(plan.course)]
        return pushes[: self.legs, :, int(np.argmax(worth - np.max([np.zeros(self.trials), *beyond], axis=0)))]

    def _path(self, plan: SwingPlan, pushes: Array, structure: str, knobs: Knobs) -> Array:
        """Return the states at the readings of each sequence of pushes; shape (looks, states, trials)."""
        states, path = plan.course.readings[-1][:, None] + np.zeros(self.trials), list[Array]()
        for held in pushes:
            for _ in range(self.looks):
                states = self.rough.laws.advanced(structure, knobs, 0.0, states, plan.look, held)
                path.append(np.nan_to_num(states, nan=_LOST))
        return np.array(path)

    def _beyond(self, path: Array) -> Array:
        return _BEYOND * np.maximum(abs(path[:, 0]) - self.limit, 0.0).sum(axis=0)

    def batch(self, _: str) -> Protocol:
        """Apply pushes of fixed sizes and durations; then fit every law."""
        calls = [asked for push in self.fixed_pushes for asked in self.rig.leg(push, self.fixed_s)]
        readings = yield calls
        yield [answer(self.model.best(list(zip(calls, readings, strict=True))))]
