"""Compares the members of a family of laws on the same readings, for certificate 12 and for reference protocols.

A task lists the possible laws. A solution fits each of them to the calls and readings and returns a `Member` for each,
with its chi-square, its answer, and the uncertainty of this answer. `surviving` returns the members that the readings
do not exclude.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from scenes.course_record import Course
from scenes.courses import Laws
from scenes.fitting import Array, refined
from scenes.protocol import AnswerValue, Member

EXCLUDED_SIGMAS = 4.0
"""Number of standard deviations by which a member must fit worse than the best one to be excluded (p < 6.4e-5)."""
_BOUND = 1e4
"""Largest misfit of a reading; larger ones are clipped, because laws with wrong constants may diverge."""
_FINER, _ROUNDS = 4, 8
"""Number by which an integration step is divided for the final iterations of the fit; largest number of these."""
_TRIALS = 500
"""Number of draws per plausible answer, before rejection by the ranges and by the readings."""
_STEP = 1e-5
"""Step of numerical derivatives, as a share of the range of a constant."""


def member(
    misfits: Callable[[Array], Array],
    predict: Callable[[Array], AnswerValue],
    best: Sequence[float] | Array,
    ranges: Sequence[tuple[float, float]],
) -> Member:
    """Return the member of a family with these best-fit constants.

    Args:
        misfits: Constants → misfit of every reading, in standard deviations.
        predict: Constants → answer.
        best: The best-fit constants.
        ranges: Smallest and largest value of each constant.
    """
    low, high = np.array(ranges, dtype=float).T
    middle = np.clip(np.asarray(best, dtype=float), low, high)
    found = misfits(middle)
    chi_square, size, count = float(found @ found), len(middle), len(found)

    def plausible(number: int) -> list[AnswerValue]:
        chosen, moved = plausible_constants(misfits, middle, (low, high), high - low, number)
        return [predict(constants) for constants in [*chosen, *moved][:number]]

    return Member(chi_square, count, size, predict(middle), plausible)


def plausible_constants(
    misfits: Callable[[Array], Array],
    best: Array,
    ranges: tuple[Array, Array],
    sizes: Array,
    number: int,
    trials: int = _TRIALS,
) -> tuple[list[Array], Array]:
    """Sample constants that are compatible with the readings.

    They are sampled from a normal distribution around the best-fit ones. Its covariance is that of linear least
    squares, (JᵀJ)⁻¹ with the Jacobian J of the misfits, scaled up if the misfits exceed the standard deviations of the
    instruments. Samples outside the ranges are rejected. Rejection sampling corrects for misfits that are not linear in
    the constants: a sample is accepted with probability min(1, exp(-Δ/2)), where Δ is its scaled chi-square minus that
    of the normal approximation.

    Args:
        misfits: Constants → misfit of every reading, in standard deviations.
        best: The best-fit constants.
        ranges: Smallest and largest value of each constant.
        sizes: Standard deviation that each constant gets if no reading depends on it.
        number: Number of sets of constants to return.
        trials: Number of samples to try for each set.

    Returns:
        The sets of constants; shape (number, constants). If fewer samples are accepted, the likeliest rejected ones are
        added; those outside the ranges are moved to their edges.
    """
    low, high = ranges
    found, steps = misfits(best), _STEP * sizes
    chi_square = float(found @ found)
    slopes = [(misfits(best + step) - misfits(best - step)) / (2 * _STEP) for step in np.diag(steps)]
    scale = max(1.0, chi_square / max(len(found) - len(best), 1))
    slope = np.column_stack(slopes) / np.sqrt(scale)

    def excess(unit: Array) -> float:
        off = misfits(best + unit * sizes)
        return (float(off @ off) - chi_square) / scale - float((slope @ unit) @ (slope @ unit) + unit @ unit)

    units = scattered(slope, trials * number)
    drawn = best + units * sizes
    # Draws outside the ranges are rejected: moving them to the edge would destroy the correlations of the constants.
    within = units[np.all((drawn >= low) & (drawn <= high), axis=1)]
    return [best + unit * sizes for unit in _likely(within, excess, number)], np.clip(drawn, low, high)


def _likely(units: Array, excess: Callable[[Array], float], number: int) -> list[Array]:
    """Accept each sample with probability exp(-excess / 2). If too few are accepted, add the likeliest rejected ones.

    Args:
        units: Samples; shape (samples, constants).
        excess: A sample → its chi-square minus that of the normal approximation.
        number: Number of samples to return.
    """
    chances = np.random.default_rng(1).random(len(units))
    kept, others = list[Array](), list[tuple[float, int]]()
    for index in range(len(units)):
        more = excess(units[index])
        if more <= -2 * np.log(chances[index]):
            kept.append(units[index])
        else:
            others.append((more, index))
        if len(kept) == number:
            break
    return [*kept, *(units[index] for _, index in sorted(others))][:number]


def scattered(slopes: Array, number: int) -> Array:
    """Sample deviations from the best-fit constants with the covariance of least squares; shape (number, constants).

    Args:
        slopes: Derivatives of the misfits with respect to the constants, each constant in units of the standard
            deviation that it gets if no reading depends on it.
        number: Number of samples.
    """
    size = slopes.shape[1]
    # The unit matrix gives constants on which no reading depends the standard deviation 1 in these units.
    # The Cholesky factor is unique, so the draws are reproducible; the signs of eigenvectors depend on the last bit.
    factor = np.linalg.cholesky(slopes.T @ slopes + np.eye(size))
    normal = np.random.default_rng(0).standard_normal((size, number))
    return np.asarray(np.linalg.solve(factor.T, normal).T, dtype=float)


def members(
    laws: Laws, course: Course, predict: Callable[[str, Mapping[str, float]], AnswerValue]
) -> dict[str, Member]:
    """Fit every structure of `laws` to a time series of pushes and readings.

    Args:
        laws: The candidate laws.
        course: Pushes and readings.
        predict: Function of a structure and its constants; returns the answer.
    """
    fits = laws.fits(course)
    return {structure: _fitted(laws, course, structure, fits[structure][1], predict) for structure in laws.structures}


def _fitted(
    laws: Laws,
    course: Course,
    structure: str,
    best: Mapping[str, float],
    predict: Callable[[str, Mapping[str, float]], AnswerValue],
) -> Member:
    """Refit a structure with shorter integration steps, from the constants that `Laws` has found."""
    names = laws.structures[structure]
    finer = replace(laws, longest_s=laws.longest_s / _FINER)
    low, high = np.array([laws.box[name] for name in names]).T

    def named(constants: Array) -> dict[str, Any]:
        return dict(zip(names, constants, strict=True))

    def misfits(units: Array) -> Array:
        constants = low[:, None] + (high - low)[:, None] * units
        return _misfits(finer, course, structure, named(constants), units.shape[1])

    start = (np.array([best[name] for name in names]) - low) / (high - low)
    found = low + (high - low) * refined(misfits, np.clip(start, 0.0, 1.0), _ROUNDS)
    return member(
        lambda constants: misfits(((constants - low) / (high - low))[:, None])[:, 0],
        lambda constants: predict(structure, {name: float(value) for name, value in named(constants).items()}),
        found,
        [laws.box[name] for name in names],
    )


def _misfits(laws: Laws, course: Course, structure: str, knobs: Mapping[str, Any], trials: int) -> Array:
    """Return the misfit of every reading in standard deviations, integrated from the start; a column per trial."""
    state, time, found = np.array(laws.start)[:, None] + np.zeros(trials), 0.0, list[Array]()
    sigma = np.array(laws.sigma)[:, None]
    with np.errstate(all="ignore"):
        for duration, control, reading in zip(course.durations, course.controls, course.readings, strict=True):
            state = laws.advanced(structure, knobs, time, state, duration, control[:, None] + np.zeros(trials))
            time += float(duration)
            found.append((state[: len(sigma)] - reading[:, None]) / sigma)
    table = np.clip(np.nan_to_num(np.array(found), nan=_BOUND), -_BOUND, _BOUND)
    return table[~np.isnan(course.readings)]


def surviving(fits: Mapping[str, Member]) -> list[str]:
    """Return the members that the readings do not exclude.

    A member is excluded by the difference between its chi-square and the lowest one. For nested laws this difference
    has a chi-square distribution whose degrees of freedom are the difference in the number of constants. If the best
    member has a reduced chi-square above 1, differences are divided by it.
    """
    best = min(fits.values(), key=lambda fit: fit.chi_square)
    scale = max(1.0, reduced_chi_square(best))
    return [
        name
        for name, fit in fits.items()
        if fit.chi_square - best.chi_square <= scale * largest_excess(best.constants - fit.constants)
    ]


def largest_excess(spared: int) -> float:
    """Return the largest excess of chi-square over that of a better law with which a law is not excluded.

    Args:
        spared: Number of constants of the better law minus that of the other one.
    """
    return float(chdtri(float(max(spared, 1)), math.erfc(EXCLUDED_SIGMAS / math.sqrt(2))))


def reduced_chi_square(fit: Member) -> float:
    """Return chi-square divided by the degrees of freedom: about 1 if the law and the standard deviations are right."""
    return fit.chi_square / max(fit.readings - fit.constants, 1)
