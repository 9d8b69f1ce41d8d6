"""Fits of a course by legs: all legs and all candidate constants are integrated at once.

The misfit of a course that is integrated from its start has many local minima, and each integration step costs a Python
step. A leg is short, so its end depends smoothly on the constants, and all legs are integrated together. The errors of
the readings are correlated between adjacent legs. `Legs` whitens them, which to first order gives the likelihood of the
whole course. Repeated around the smoothed path, this is multiple shooting. Terms outside the current law enter as
integrals of their force along the path (the weak form).

Source: H. G. Bock, Recent advances in parameter identification techniques for O.D.E. (1983), for multiple shooting;
D. A. Messenger and D. M. Bortz, Weak SINDy (2021), for the weak form.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from scenes.courses import Course
from scenes.fitting import Array
from scenes.integration import advanced
from scenes.worlds.drawing import searched
from scenes.worlds.equations import rates_of
from scenes.worlds.experiment import SEARCH_S, Situation
from scenes.worlds.law_texts import ODO_RATE
from scenes.worlds.parts import Range
from scenes.worlds.terms import Structure, Term

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_AT: Array = np.concatenate([[0.0], (_NODES + 1) / 2])
"""Positions of the points of a leg, as fractions of its duration: its start, then those of a Gauss quadrature."""
_SHIFT = 1e-5
"""Step of the finite difference for the transition of a leg [m, m/s]."""
_FAR = 1e3
"""Largest misfit of a leg, in standard deviations; larger ones are clipped."""
_PULL = 0.3
"""Weight of the regularisation towards the middle of the unit cube."""
_DRIFTS = (0.02, *np.geomspace(0.1, 300.0, 12))
"""Candidate sizes of the model error, in standard deviations of a reading per leg."""


def box_of(bounds: Range) -> tuple[float, float]:
    """Return the search range of a constant: that of a fit, except that angles are unbounded."""
    low, high = searched(bounds)
    if bounds.scale == "angle":
        half = (high - low) / 2
        return low - half, high + half
    return low, high


def to_value(bounds: Range, unit: Any) -> Any:
    """Return the value of a constant at a point of its box."""
    low, high = box_of(bounds)
    return low * (high / low) ** unit if low > 0 else low + (high - low) * unit


def to_unit(bounds: Range, value: Any) -> Any:
    """Return the point of its box at which a constant has a value."""
    low, high = box_of(bounds)
    return np.log(np.maximum(value, 1e-9) / low) / math.log(high / low) if low > 0 else (value - low) / (high - low)


def named(structure: Structure, units: Array) -> dict[str, Any]:
    """Return the constants of a structure at points of the unit cube; a column for each point."""
    return {name: to_value(bounds, unit) for (name, bounds), unit in zip(structure.ranges.items(), units, strict=True)}


@dataclass(frozen=True)
class Legs:
    """The legs between the readings of a course, linearised around a path.

    Attributes:
        course: Controls and readings.
        told: The apparatus and its instruments.
        path: Readable state at the start and at each reading, around which errors are linearised.
        drift: Model error per leg, in standard deviations of a reading.
    """

    course: Course
    told: Situation
    path: Array
    drift: float = 1.0

    @classmethod
    def of(cls, course: Course, told: Situation) -> "Legs":
        """Return the legs linearised around the readings themselves."""
        bare = Structure(told.apparatus, (), told.radius)
        return cls(course, told, np.vstack([np.array(bare.start)[: bare.read], course.readings]))

    @property
    def _width(self) -> int:
        return 2 if self.told.apparatus.flat else 1

    @functools.cached_property
    def begun(self) -> Array:
        """Start time of each leg [s]."""
        return np.cumsum(self.course.durations) - self.course.durations

    def _along(self, shares: Array) -> Array:
        """The path at fractions of every leg, by cubic interpolation; shape (states, legs × fractions)."""
        nodes = self.path.reshape(len(self.path), self.told.bodies, 2, self._width)
        h, u = self.course.durations[:, None, None, None], shares[None, :, None, None]
        (a, va), (b, vb) = ((ends[:, :, 0][:, None], ends[:, :, 1][:, None]) for ends in (nodes[:-1], nodes[1:]))
        place = (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * h * va
        place = place + (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * h * vb
        speed = (6 * u**2 - 6 * u) * (a - b) / h + (3 * u**2 - 4 * u + 1) * va + (3 * u**2 - 2 * u) * vb
        return np.stack([place, speed], axis=3).reshape(-1, self.path.shape[1]).T

    @functools.cached_property
    def _points(self) -> Array:
        """The path at the start and the quadrature points of each leg, then at the end of the last leg."""
        return np.column_stack([self._along(_AT), self.path[-1]])

    @functools.cached_property
    def _times(self) -> Array:
        inner = (self.begun[:, None] + _AT * self.course.durations[:, None]).ravel()
        return np.append(inner, self.course.durations.sum())

    @functools.cached_property
    def _between(self) -> Array:
        """Return the path at the midpoint between two points."""
        return self._along((_AT + np.append(_AT[1:], 1.0)) / 2)

    @functools.cached_property
    def _way(self) -> Array:
        """Return path length and speed of the first body at each point."""
        speed = np.linalg.norm(self._points[self._width : 2 * self._width], axis=0)
        gone = np.append(0.0, np.cumsum(np.diff(self._times) * (speed[1:] + speed[:-1]) / 2))
        return np.array([np.maximum(gone - speed / ODO_RATE, 0.0), speed])

    def _hidden(self, term: Term, constants: Mapping[str, Any], trials: int) -> Array:
        """The state of a term's hidden body at each point, driven by the path; shape (states, points, trials)."""
        alone = Structure(self.told.apparatus, (Term(term.form),), self.told.radius)
        rates, seen, size = rates_of(alone, walled=False), alone.read, len(alone.states) - alone.read
        gaps = np.diff(self._times)
        found = np.zeros((size, len(self._times), trials))

        def moved(knobs: Mapping[str, Any], hidden: Array, places: Sequence[Array], h: Any) -> Array:
            """Return the hidden body's state after an interval, from positions at its start, middle and end."""

            def rate(place: Array, now: Array) -> Array:
                state = np.zeros((seen + size, now.shape[1]))
                state[: len(place)], state[seen:] = place, now
                return rates(knobs, np.zeros((alone.controls, 1)))(0.0, state)[seen:]

            a = rate(places[0], hidden)
            b = rate(places[1], hidden + h / 2 * a)
            c = rate(places[1], hidden + h / 2 * b)
            d = rate(places[2], hidden + h * c)
            return hidden + h / 6 * (a + 2 * b + 2 * c + d)

        if not _is_linear(alone):
            for at, h in enumerate(gaps):
                places = [self._points[:, [at]], self._between[:, [at]], self._points[:, [at + 1]]]
                found[:, at + 1] = moved(constants, found[:, at], places, h)
            return found
        # The state after a gap is linear in the state before it and in the places: the matrices of each gap of a leg.
        own, inner = 2 * self._width, len(_AT)
        basis = np.eye(size + 3 * own)
        cases = np.repeat(np.tile(basis, inner), trials, axis=1)
        knobs = {n: np.tile(np.broadcast_to(v, (trials,)), inner * len(basis)) for n, v in constants.items()}
        h = np.repeat(gaps[:inner], len(basis) * trials)
        places = [cases[size + own * place : size + own * (place + 1)] for place in range(3)]
        maps = moved(knobs, cases[:size], places, h).reshape(size, inner, len(basis), trials)
        rows = np.concatenate([self._points[:own, :-1], self._between[:own], self._points[:own, 1:]])
        driven = np.einsum("dgst,slg->lgtd", maps[:, :, size:], rows.reshape(3 * own, -1, inner))
        driven = driven.reshape(-1, trials, size, 1)
        matrices = [np.ascontiguousarray(maps[:, gap, :size].transpose(2, 0, 1)) for gap in range(inner)]
        now = np.zeros((trials, size, 1))
        for at, part in enumerate(driven):
            now = matrices[at % inner] @ now + part
            found[:, at + 1] = now[:, :, 0].T
        return found

    def _states(self, structure: Structure, constants: Mapping[str, Any], trials: int, points: Any) -> Array:
        """The complete state at points of the path; shape (states, points, trials)."""
        rows = [np.broadcast_to(self._points[:, points, None], (structure.read, len(points), trials))]
        for at in structure.hidden:
            term = structure.terms[at]
            own = {name: constants[name] for name in ("m", "m2") if name in constants}
            own |= {
                alone: constants[name]
                for alone, name in zip(Term(term.form).ranges(0), Term(term.form).ranges(at), strict=True)
            }
            rows.append(self._hidden(term, own, trials)[:, points])
        if structure.worn:
            rows.append(np.broadcast_to(self._way[:, points, None], (2, len(points), trials)))
        return np.concatenate(rows)

    def ends(
        self, structure: Structure, constants: Mapping[str, Any], trials: int, shift: Array | None = None
    ) -> Array:
        """The readable state at the end of each leg by a law; shape (legs, read, trials).

        Args:
            structure: Which terms act.
            constants: Their constants; a value for each trial.
            trials: Number of trials.
            shift: Added to the state at the start of each leg; shape (read, trials).
        """
        legs = len(self.course.durations)
        state = self._states(structure, constants, trials, np.arange(legs) * len(_AT))
        if shift is not None:
            state[: structure.read] += shift[:, None]
        rates, held = rates_of(structure, walled=True), self.course.controls.T[:, :, None]

        end = advanced(rates(constants, held), self.begun[:, None], state, self.course.durations[:, None], SEARCH_S)
        return end[: structure.read].transpose(1, 0, 2)

    def about(self, structure: Structure, unit: Array) -> "Whitened":
        """Return the legs with the transitions of a law."""
        size = structure.read
        constants = named(structure, np.repeat(unit[:, None], size + 1, axis=1))
        shift = _SHIFT * np.column_stack([np.zeros(size), np.eye(size)])
        with np.errstate(all="ignore"):
            ends = self.ends(structure, constants, size + 1, shift)
        slopes = np.clip(np.nan_to_num((ends[:, :, 1:] - ends[:, :, :1]) / _SHIFT), -20, 20)
        return Whitened(self, slopes)

    def columns(self, term: Term, constants: Mapping[str, Any], trials: int) -> Array:
        """Return the change of the readable state at the end of each leg by a term; shape (legs × read, trials)."""
        structure = Structure(self.told.apparatus, (term,), self.told.radius)
        legs, inner = len(self.course.durations), len(_AT) - 1
        points = (np.arange(legs)[:, None] * len(_AT) + np.arange(1, len(_AT))).ravel()
        state = self._states(structure, constants, trials, points)
        held = np.repeat(self.course.controls, inner, axis=0).T[:, :, None]
        found = rates_of(structure, walled=False)(constants, held)(self._times[points][:, None], state)
        bodies, width = structure.bodies, self._width
        rates = found[: structure.read].reshape(bodies, 2, width, legs * inner, trials)[:, 1]
        masses = [constants["m"], *([constants["m2"]] if bodies > 1 else [])]
        pushed = held.reshape(bodies, width, -1, 1) / np.stack(masses).reshape(bodies, 1, 1, -1)
        parts = (rates - pushed).reshape(bodies, width, legs, inner, trials)
        h = self.course.durations[:, None, None]
        speed = np.einsum("bwlit,i->lbwt", parts, _WEIGHTS / 2) * h[:, None]
        place = np.einsum("bwlit,i->lbwt", parts, _WEIGHTS / 2 * (1 - _AT[1:])) * h[:, None] ** 2
        return np.stack([place, speed], axis=2).reshape(-1, trials)


@functools.lru_cache(64)
def _is_linear(structure: Structure) -> bool:
    """Return whether there is one term, whose hidden body obeys equations linear in the states of both bodies."""
    rng = np.random.default_rng(0)
    one = rng.standard_normal(len(structure.states))
    states = np.column_stack([one, 2 * one, -one])
    knobs = {name: np.full(3, (bounds.low + bounds.high) / 2) for name, bounds in structure.ranges.items()}
    found = rates_of(structure, walled=False)(knobs, np.zeros((structure.controls, 1)))(0.0, states)[structure.read :]
    return bool(np.allclose(found, np.column_stack([found[:, 0], 2 * found[:, 0], -found[:, 0]])))


@dataclass(frozen=True)
class Whitened:
    """Legs whose misfits are whitened with the transitions of an approximate law.

    Attributes:
        legs: The legs.
        slopes: Derivative of the end of each leg with respect to its start; shape (legs, read, read).
    """

    legs: Legs
    slopes: Array

    @functools.cached_property
    def _sigma(self) -> Array:
        return np.tile(self.legs.told.sigma, len(self.slopes))

    @functools.cached_property
    def _carried(self) -> Array:
        """Errors of the readings → errors of the legs: the error at the end minus the propagated one at the start."""
        count, size = self.slopes.shape[:2]
        found = np.eye(count * size)
        for leg in range(1, count):
            found[leg * size : (leg + 1) * size, (leg - 1) * size : leg * size] = -self.slopes[leg]
        return found

    @functools.cached_property
    def _known(self) -> Array:
        """Covariance of the legs from the errors of the readings."""
        spread = self._carried * self._sigma
        return spread @ spread.T

    def _covariance(self, drift: float) -> Array:
        return self._known + np.diag((drift * self._sigma) ** 2)

    @functools.cached_property
    def matrix(self) -> Array:
        """The matrix that whitens misfits of legs."""
        return cast(Array, np.linalg.inv(np.linalg.cholesky(self._covariance(self.legs.drift))))

    def errors(self, structure: Structure, units: Array) -> Array:
        """Misfits of the legs [m, m/s]; a column for each point of the unit cube."""
        trials, path = units.shape[1], self.legs.path
        ends = self.legs.ends(structure, named(structure, units), trials)
        away = np.vstack([np.zeros(path.shape[1]), (self.legs.course.readings - path[1:])[:-1]])
        carried = np.einsum("lij,lj->li", self.slopes, away)
        found = (self.legs.course.readings - carried)[:, :, None] - ends
        limit = _FAR * self._sigma[:, None]
        return np.clip(np.nan_to_num(found.reshape(-1, trials), nan=1e9), -limit, limit)

    def misfits(self, structure: Structure, units: Array) -> Array:
        """Misfits in standard deviations, then regularisation terms; a column for each point of the unit cube."""
        with np.errstate(all="ignore"):
            found = self.matrix @ self.errors(structure, units)
        return np.vstack([found, _PULL * (units - 0.5)])

    def smoothed(self, structure: Structure, unit: Array) -> Legs:
        """Legs around the most likely path for a law and the readings, with the best-fit model error."""
        with np.errstate(all="ignore"):
            wrong = self.errors(structure, unit[:, None])[:, 0]
        best, least = self.legs.drift, math.inf
        for drift in _DRIFTS:
            factor = np.linalg.cholesky(self._covariance(drift))
            white = np.linalg.solve(factor, wrong)
            cost = float(white @ white + 2 * np.log(np.diag(factor)).sum())
            if cost < least:
                best, least = drift, cost
        read = self._sigma**2 * (self._carried.T @ np.linalg.solve(self._covariance(best), wrong))
        path = self.legs.path.copy()
        path[1:] = self.legs.course.readings - read.reshape(len(self.slopes), -1)
        return replace(self.legs, path=path, drift=float(best))
