"""Fits of laws leg by leg: all legs and all candidate constants are integrated at once.

If a law is integrated over all legs in sequence, its misfit has many local minima, and each integration step costs a
Python step. A leg is short, so its end depends smoothly on the constants, and all legs are integrated together. The
errors of the readings are correlated between adjacent legs. `Legs` whitens them, which to first order gives the
likelihood of all readings. Repeated around the smoothed path, this is multiple shooting. Terms outside the
current law enter as integrals of their force along the path (the weak form).

Source: H. G. Bock, Recent advances in parameter identification techniques for O.D.E. (1983), for multiple shooting;
D. A. Messenger and D. M. Bortz, Weak SINDy (2021), for the weak form.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from scenes.course_record import Course
from scenes.fitting import Array, advanced
from scenes.worlds.drawing import searched
from scenes.worlds.equations import rates_of
from scenes.worlds.experiment import SEARCH_S, Situation
from scenes.worlds.hidden_paths import SampledPath, hidden_states
from scenes.worlds.instrument_errors import kinematic_errors
from scenes.worlds.law_texts import ODO_RATE
from scenes.worlds.parts import Range
from scenes.worlds.terms import Structure, Term

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_AT: Array = np.concatenate([[0.0], (_NODES + 1) / 2])
"""Positions of the points of a leg, as fractions of its duration: its start, then those of a Gauss quadrature."""
_HIDDEN_STEPS = 3
"""Integration steps of a hidden body in a leg."""
_SHIFT = 1e-5
"""Step of the finite difference for the transition of a leg [m, m/s]."""
_FAR = 1e3
"""Largest misfit of a leg, in standard deviations; larger ones are clipped."""
_UNREAD = 1e4
"""Standard deviation of a reading that was not made, in those of one that was."""
_PULL = 0.3
"""Weight of the regularisation towards the middle of the unit cube."""
_DRIFTS = (0.02, *np.geomspace(0.1, 300.0, 12))
"""Candidate sizes of the model error, in standard deviations of a reading per leg."""


def box_of(bounds: Range) -> tuple[float, float]:
    """Return the search range of a constant: as `searched`, except that angles are unbounded."""
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
    """The legs between the readings of an experiment, linearised around a path.

    Attributes:
        course: Pushes and readings.
        told: The apparatus and its instruments.
        path: Readable state at the start and at each reading, around which errors are linearised.
        drift: Model error per leg, in standard deviations of a reading.
        unread: Mask of readings that were not made, whose values are those of a law; None if all were made.
    """

    course: Course
    told: Situation
    path: Array
    drift: float = 1.0
    unread: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, course: Course, told: Situation) -> "Legs":
        """Create legs that are linearised around the readings minus the estimated error of the position instrument."""
        bare = Structure(told.apparatus, (), told.radius)
        path = np.vstack([np.array(bare.start)[: bare.read], course.readings])
        if told.errors:
            spread = told.spread(course.durations)
            nodes = path.reshape(len(path), told.bodies, 2, told.width)
            places, speeds = (nodes[:, :, at].reshape(len(path), -1) for at in (0, 1))
            of_places = spread.reshape(*nodes[1:].shape, -1)[:, :, 0].reshape(*places[1:].shape, -1)
            found = kinematic_errors(places, speeds, course.durations, of_places)
            path[1:] -= (spread @ found).reshape(course.readings.shape)
        return cls(course, told, path)

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

    def _sampled(self, shares: Array) -> SampledPath:
        """Return the path at fractions of each leg. The first fraction must be 0."""
        inner = (self.begun[:, None] + shares * self.course.durations[:, None]).ravel()
        return SampledPath(
            len(shares),
            np.append(inner, self.course.durations.sum()),
            np.column_stack([self._along(shares), self.path[-1]]),
            self._along((shares + np.append(shares[1:], 1.0)) / 2),
        )

    @functools.cached_property
    def _for_forces(self) -> SampledPath:
        """The path at the points at which the forces of terms are evaluated."""
        return self._sampled(_AT)

    @functools.cached_property
    def _for_starts(self) -> SampledPath:
        """The path at fewer points per leg, for computing the states at the starts of legs."""
        return self._sampled(np.arange(_HIDDEN_STEPS) / _HIDDEN_STEPS)

    @functools.cached_property
    def _way(self) -> Array:
        """Return path length and speed of the first body at each point of `_for_forces`."""
        sampled = self._for_forces
        speed = np.linalg.norm(sampled.points[self._width : 2 * self._width], axis=0)
        gone = np.append(0.0, np.cumsum(np.diff(sampled.times) * (speed[1:] + speed[:-1]) / 2))
        return np.array([np.maximum(gone - speed / ODO_RATE, 0.0), speed])

    def _states(
        self, structure: Structure, constants: Mapping[str, Any], trials: int, sampled: SampledPath, points: Any
    ) -> Array:
        """The state, hidden bodies and path length included, at points of the path; shape (states, points, trials)."""
        rows = [np.broadcast_to(sampled.points[:, points, None], (structure.read, len(points), trials))]
        for at in structure.hidden:
            term = structure.terms[at]
            own = {name: constants[name] for name in ("m", "m2") if name in constants}
            own |= {new: constants[name] for new, name in zip(term.plain.ranges(0), term.plain.ranges(at), strict=True)}
            alone = Structure(self.told.apparatus, (term.plain,), self.told.radius)
            rows.append(hidden_states(alone, own, trials, sampled)[:, points])
        if structure.worn:
            fine = self._for_forces
            points = points if sampled is fine else points // sampled.inner * fine.inner
            rows.append(np.broadcast_to(self._way[:, points, None], (2, len(points), trials)))
        return np.concatenate(rows)

    def ends(
        self, structure: Structure, constants: Mapping[str, Any], trials: int, shift: Array | None = None
    ) -> Array:
        """Predict the readable state at the end of each leg from a law; shape (legs, read, trials).

        Args:
            structure: The terms of the law.
            constants: Their constants; a value for each trial.
            trials: Number of trials.
            shift: Change of the readable state at the start of each leg; shape (read, trials).
        """
        sampled = self._for_starts
        starts = np.arange(len(self.course.durations)) * sampled.inner
        state = self._states(structure, constants, trials, sampled, starts)
        if shift is not None:
            state[: structure.read] += shift[:, None]
        rates, held = rates_of(structure, walled=True), self.course.controls.T[:, :, None]

        end = advanced(rates(constants, held), self.begun[:, None], state, self.course.durations[:, None], SEARCH_S)
        return end[: structure.read].transpose(1, 0, 2)

    def about(self, structure: Structure, unit: Array) -> "Whitened":
        """Return the legs with whitened misfits. A law gives the derivative of each leg's end by its start."""
        size = structure.read
        constants = named(structure, np.repeat(unit[:, None], size + 1, axis=1))
        shift = _SHIFT * np.column_stack([np.zeros(size), np.eye(size)])
        with np.errstate(all="ignore"):
            ends = self.ends(structure, constants, size + 1, shift)
        slopes = np.clip(np.nan_to_num((ends[:, :, 1:] - ends[:, :, :1]) / _SHIFT), -20, 20)
        return Whitened(self, slopes)

    def columns(self, term: Term, constants: Mapping[str, Any], trials: int) -> Array:
        """Return how much a term changes the readable state at the end of each leg; shape (legs × read, trials)."""
        structure = Structure(self.told.apparatus, (term,), self.told.radius)
        legs, inner = len(self.course.durations), len(_AT) - 1
        points = (np.arange(legs)[:, None] * len(_AT) + np.arange(1, len(_AT))).ravel()
        sampled = self._for_forces
        state = self._states(structure, constants, trials, sampled, points)
        held = np.repeat(self.course.controls, inner, axis=0).T[:, :, None]
        found = rates_of(structure, walled=False)(constants, held)(sampled.times[points][:, None], state)
        bodies, width = structure.bodies, self._width
        rates = found[: structure.read].reshape(bodies, 2, width, legs * inner, trials)[:, 1]
        masses = [constants["m"], *([constants["m2"]] if bodies > 1 else [])]
        pushed = held.reshape(bodies, width, -1, 1) / np.stack(masses).reshape(bodies, 1, 1, -1)
        parts = (rates - pushed).reshape(bodies, width, legs, inner, trials)
        h = self.course.durations[:, None, None]
        speed = np.einsum("bwlit,i->lbwt", parts, _WEIGHTS / 2) * h[:, None]
        place = np.einsum("bwlit,i->lbwt", parts, _WEIGHTS / 2 * (1 - _AT[1:])) * h[:, None] ** 2
        return np.stack([place, speed], axis=2).reshape(-1, trials)


@dataclass(frozen=True)
class Whitened:
    """Legs whose misfits are whitened. An approximate law gives the change of each leg's end with its start.

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
    def _errors(self) -> Array:
        """Standard deviation of each reading."""
        return self._sigma if self.legs.unread is None else self._sigma * np.where(self.legs.unread.ravel(), _UNREAD, 1)

    @functools.cached_property
    def _carried(self) -> Array:
        """Map errors of readings to errors of legs: the error at the end minus the propagated error at the start."""
        count, size = self.slopes.shape[:2]
        found = np.eye(count * size)
        for leg in range(1, count):
            found[leg * size : (leg + 1) * size, (leg - 1) * size : leg * size] = -self.slopes[leg]
        return found

    @functools.cached_property
    def _known(self) -> Array:
        """Covariance of the legs from the errors of the readings: noise, and the error of the position instrument."""
        spread = self._carried * self._errors
        if not self.legs.told.errors:
            return spread @ spread.T
        shared = self._carried @ self._shared
        return spread @ spread.T + shared @ shared.T

    @functools.cached_property
    def _shared(self) -> Array:
        return self.legs.told.spread(self.legs.course.durations)

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
        pulled = self._carried.T @ np.linalg.solve(self._covariance(best), wrong)
        read = self._errors**2 * pulled + self._shared @ (self._shared.T @ pulled)
        path = self.legs.path.copy()
        path[1:] = self.legs.course.readings - read.reshape(len(self.slopes), -1)
        return replace(self.legs, path=path, drift=float(best))
