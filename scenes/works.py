"""Fits a potential to positions, speeds and the work of pushes on a body without friction. Used by reference protocols.

The energy m v²/2 + V(x) of the body changes only by the work of the pushes. A push F that begins at x0 has done the
work F (x - x0) at x. The error of x0 enters the work of all later points, so their errors are correlated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.course_record import accepted
from scenes.family import member, plausible_constants
from scenes.fitting import Array
from scenes.protocol import AnswerValue, Exchanges, Member
from scenes.rigs import Rig

_TRIALS = 100
"""Number of draws per plausible potential while a body is pumped. It is small because many plans are made."""


@dataclass(frozen=True, slots=True)
class Refit:
    """The result of a fit of the free constants to the points."""

    chi_square: float
    """Sum of the squared misfits, plus the logarithm of the determinant of the covariance of the points."""
    constants: Array
    """All constants, those that are not free included."""
    free: Sequence[int]
    """Indices of the free constants."""
    misfits: Callable[[Array], Array]
    """Free constants → misfits of the points in standard deviations."""
    scale: Array
    """Typical sizes of the free constants."""
    highest: Array
    """Upper bounds of the free constants; the lower ones are 0."""

    def plausible(self, number: int) -> Array:
        """Return the best-fit constants and random ones that fit the points; shape (constants, up to 1 + number)."""
        which, ranges = list(self.free), (np.zeros(len(self.free)), self.highest)
        best = self.constants[which]
        chosen, _ = plausible_constants(self.misfits, best, ranges, self.scale, number, _TRIALS)
        drawn = self.constants[:, None] + np.zeros(1 + len(chosen))
        drawn[which] = np.column_stack([best, *chosen])
        return drawn


def work_points(exchanges: Exchanges, rig: Rig, error: float, within: float) -> Array:
    """Return the points of a motion until a latch holds the body.

    Args:
        exchanges: Calls and results.
        rig: The push, and the readings of position and speed.
        error: Standard deviation of a position [m, rad].
        within: Distance beyond which a latch holds the body [m, rad].

    Returns:
        Positions, speeds, accumulated work, pushes, and the variances of the work from the errors of the positions
        where pushes began; shape (5, n), with n at least 1.
    """
    pushed, (place, speed) = rig.controls[0], rig.readings
    began = push = work = doubt = last = 0.0
    points = list[tuple[float, ...]]()
    for asked, got in accepted(exchanges):
        if asked.tool == pushed.tool:
            work += push * (last - began)
            doubt += (error * (pushed.of(asked.arguments) - push)) ** 2
            began, push = last, pushed.of(asked.arguments)
        elif asked.tool == place.tool:
            last = place.of(got)
        elif asked.tool == speed.tool:
            points.append((last, speed.of(got), work + push * (last - began), push, doubt))
        if abs(last) > within:
            break
    kept = [point for point in points if abs(point[0]) <= within]
    return np.array(kept or [(0.0,) * 5]).T


def whitening(doubt: Array, alone: Array) -> Array:
    """Return the whitening matrix, which makes the errors of all points independent with variance 1.

    Args:
        doubt: Variance of the accumulated work at each point; it is shared with all later points and never decreases.
        alone: Independent variance of each point.
    """
    together = np.minimum.outer(doubt, doubt) + np.diag(alone)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(together)), dtype=float)


def guesses(guess: Array, free: Sequence[int], begins: Sequence[int], places: Sequence[float]) -> list[Array]:
    """Return initial values of all constants, one array for each position at which the free springs may engage.

    Args:
        guess: Typical values of all constants; those that are not free become 0.
        free: Indices of the free constants.
        begins: Indices of the constants that are positions at which a spring engages.
        places: The positions.
    """
    found = list[Array]()
    for place in places:
        start = np.where(np.isin(np.arange(len(guess)), free), guess, 0.0)
        start[list(begins)] = np.where(start[list(begins)] > 0, place, 0.0)
        found.append(start)
    return found


def refitted(
    starts: Sequence[Array],
    free: Sequence[int],
    doubt: Array,
    alone: Callable[[Array], Array],
    misfits: Callable[[Array], tuple[Array, Array]],
    scale: Array,
    highest: Array,
    margin: float,
) -> Refit:
    """Fit the free constants twice; the second fit uses the errors computed from the first.

    Args:
        starts: Several initial values of all constants.
        free: Indices of the free constants.
        doubt: Variance of the work at each point.
        alone: Function of the constants; returns the independent variance of each point.
        misfits: Function of the constants; returns the misfits of the points, and other misfits in standard deviations.
        scale: Typical sizes of all constants.
        highest: Upper bounds of all constants; the lower ones are 0.
        margin: Smallest distance of the fitted constants from their bounds.

    Returns:
        The fit with the lowest chi-square.
    """
    which = list(free)
    scale, highest = scale[which], highest[which]

    def fitted(constants: Array) -> Refit:
        def whitened(white: Array) -> Callable[[Array], Array]:
            def off(q: Array) -> Array:
                full = constants.copy()
                full[which] = q
                points, others = misfits(full)
                return np.concatenate((white @ points, others))

            return off

        found, white, cost, off = constants.copy(), np.eye(len(doubt)), np.inf, whitened(np.eye(len(doubt)))
        for _ in range(2):
            white = whitening(doubt, alone(found))
            off = whitened(white)
            got = least_squares(off, found[which], bounds=(0, highest), x_scale=scale, max_nfev=40)
            cost = float(got.cost)
            found[which] = np.clip(got.x, margin, highest - margin)
        return Refit(2 * cost - 2 * float(np.sum(np.log(np.diag(white)))), found, which, off, scale, highest)

    return min(map(fitted, starts), key=lambda fit: fit.chi_square)


def cheapest(fits: Mapping[str, Refit], count: int) -> Refit:
    """Return the fit with the smallest Bayesian information criterion: chi-square + constants · ln(points).

    Args:
        fits: The fit of each structure.
        count: Number of points.
    """
    return min(fits.values(), key=lambda fit: fit.chi_square + len(fit.free) * np.log(count))


def weighed(
    fits: Mapping[str, Refit],
    white: Array,
    misfits: Callable[[Array], Array],
    predict: Callable[[Array], AnswerValue],
    highest: Array,
) -> dict[str, Member]:
    """Fit all structures of a family of potentials to the same points, with the same errors.

    Args:
        fits: The last fit of each structure, from which the new fit starts.
        white: Whitening matrix of the points.
        misfits: Function of all constants; returns the misfits of the points.
        predict: Function of all constants; returns the answer.
        highest: Upper bounds of all constants; the lower ones are 0.
    """

    def of(name: str) -> Member:
        which, found = list(fits[name].free), fits[name].constants

        def full(constants: Array) -> Array:
            every = found.copy()
            every[which] = constants
            return every

        def off(constants: Array) -> Array:
            return white @ misfits(full(constants))

        start = np.clip(found[which], 1e-6, highest[which] - 1e-6)
        best = least_squares(off, start, bounds=(0, highest[which]), x_scale=np.maximum(start, 1e-2)).x
        return member(off, lambda constants: predict(full(constants)), best, [(0.0, high) for high in highest[which]])

    return {name: of(name) for name in fits}


def parts_of_way(speed_at: Callable[[Array], Array], start: float, end: float, count: int = 400) -> tuple[Array, Array]:
    """Divide a path between two positions into parts; returns their durations and positions.

    The substitution x = (start + end)/2 - (end - start)/2 cos(u) removes the singularity where the speed is 0.

    Args:
        speed_at: Speed at positions, above 0 between the ends.
        start: First position.
        end: Last position.
        count: Number of parts.
    """
    edges = np.linspace(0, pi, count + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    x = (start + end) / 2 - (end - start) / 2 * np.cos(middle)
    return abs(end - start) / 2 * np.sin(middle) * (pi / count) / speed_at(x), x
