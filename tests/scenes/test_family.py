"""Tests of comparing laws on the same readings: linear least squares with results known in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from scenes.course_record import Course
from scenes.courses import Knobs, Laws
from scenes.family import member, members, reduced_chi_square, scattered, surviving
from scenes.fitting import Array
from scenes.protocol import AnswerValue, Member

SIGMA = 0.1
PLACES = np.arange(1.0, 6.0)


def line(read: Array, ranges: tuple[float, float] = (-100.0, 100.0)) -> Member:
    """Fit a straight line through 0; the answer is its value at 10."""
    slope = float(PLACES @ read / (PLACES @ PLACES))
    return member(lambda p: (p[0] * PLACES - read) / SIGMA, lambda p: float(10 * p[0]), [slope], [ranges])


def test_a_fit_tells_its_chi_square_and_its_answer() -> None:
    read = 2 * PLACES + SIGMA * np.array([1, -1, 0, 1, -1])
    fit = line(read)
    slope = PLACES @ read / (PLACES @ PLACES)
    assert (fit.readings, fit.constants) == (5, 1)
    assert fit.answer == pytest.approx(10 * slope)
    assert fit.chi_square == pytest.approx(np.sum((slope * PLACES - read) ** 2) / SIGMA**2)
    assert reduced_chi_square(fit) == pytest.approx(fit.chi_square / 4)


def test_plausible_answers_scatter_with_the_standard_error_of_least_squares() -> None:
    answers = np.array(line(2 * PLACES).plausible(4000), dtype=float)
    assert answers.mean() == pytest.approx(20.0, abs=0.03)
    assert answers.std() == pytest.approx(10 * SIGMA / math.sqrt(PLACES @ PLACES), rel=0.05)


def test_misfits_larger_than_stated_widen_the_plausible_answers() -> None:
    read = 2 * PLACES + 30 * SIGMA * np.array([1, -2, 2, -2, 1])
    fit = line(read)
    error = 10 * SIGMA / math.sqrt(PLACES @ PLACES) * math.sqrt(reduced_chi_square(fit))
    assert np.std(np.array(fit.plausible(4000), dtype=float)) == pytest.approx(error, rel=0.05)


def test_no_constant_is_drawn_outside_of_its_range() -> None:
    answers = np.array(line(2 * PLACES, (2.0, 3.0)).plausible(100), dtype=float)
    assert 20.0 <= answers.min() < answers.max() <= 30.0


def test_constants_of_which_the_readings_tell_the_sum_are_drawn_with_this_sum() -> None:
    # The best value of one constant is 0, its lower bound. Raising negative draws to 0 would change the sum.
    fit = member(lambda p: (p.sum() - 2) * PLACES / SIGMA, lambda p: float(p.sum()), [2.0, 0.0], [(0.0, 9.0)] * 2)
    answers = np.array(fit.plausible(100), dtype=float)
    assert np.abs(answers - 2).max() < 0.1


def test_draws_that_the_readings_contradict_are_rejected() -> None:
    # A line whose slope changes by k at the position b. The best k is 0, so b is undetermined to first order.
    def misfits(p: Array) -> Array:
        return (p[0] * PLACES + p[1] * np.maximum(PLACES - p[2], 0.0) - 2 * PLACES) / SIGMA

    fit = member(misfits, lambda p: float(misfits(p) @ misfits(p)), [2.0, 0.0, 4.5], [(0.0, 9.0)] * 2 + [(0.0, 5.0)])
    chi_squares = np.array(fit.plausible(400), dtype=float)
    assert chi_squares.mean() < 3.0
    assert chi_squares.max() < 25.0


def test_draws_follow_the_covariance_of_least_squares() -> None:
    slopes = np.array([[3.0, 1.0], [0.0, 2.0], [1.0, 1.0]])
    drawn = scattered(slopes, 40_000)
    assert np.cov(drawn.T) == pytest.approx(np.linalg.inv(slopes.T @ slopes + np.eye(2)), rel=0.05)


def test_a_constant_that_no_reading_depends_on_is_drawn_from_its_range() -> None:
    fit = member(lambda p: (2 + 0 * p[0]) * PLACES - 2 * PLACES, lambda p: float(p[0]), [5.0], [(0.0, 10.0)])
    answers = np.array(fit.plausible(4000), dtype=float)
    assert answers.std() == pytest.approx(10 / math.sqrt(12), rel=0.1)


def test_a_law_is_excluded_by_four_standard_deviations() -> None:
    best = line(2 * PLACES)
    near, far = replace(best, chi_square=15.9), replace(best, chi_square=16.1)
    assert surviving({"best": best, "near": near, "far": far}) == ["best", "near"]


def test_a_law_that_spares_constants_is_excluded_by_the_distribution_of_as_many_degrees_of_freedom() -> None:
    # The quantiles at p = 6.3e-5 of chi-square with 1, 2 and 3 degrees of freedom are 16.0, 19.3 and 22.1.
    best = replace(line(2 * PLACES), constants=4)
    spared = {
        f"{spares} at {gap}": replace(best, constants=4 - spares, chi_square=gap)
        for spares, gap in ((1, 17.0), (2, 17.0), (2, 20.0), (3, 20.0), (3, 23.0))
    }
    assert surviving({"best": best} | spared) == ["best", "2 at 17.0", "3 at 20.0"]


def test_differences_count_in_units_of_the_best_reduced_chi_square() -> None:
    best = replace(line(2 * PLACES), chi_square=8.0)  # of 4 degrees of freedom
    assert surviving({"best": best, "other": replace(best, chi_square=39.0)}) == ["best", "other"]
    assert surviving({"best": best, "other": replace(best, chi_square=41.0)}) == ["best"]


def _rates(structure: str, knobs: Knobs, _: object, state: Array, controls: Array) -> Array:
    _place, v = state
    return np.array([v, (controls[0] - knobs["drag"] * (v if structure == "linear" else v * abs(v))) / 2.0])


def test_laws_of_motion_are_fitted_to_a_course_and_compared() -> None:
    laws = Laws(
        rates=_rates,
        structures={"linear": ("drag",), "square": ("drag",)},
        box={"drag": (0.1, 5.0)},
        start=(0.0, 0.0),
        sigma=(1e-3, 1e-3),
    )
    durations, forces = np.array([0.5, 0.8, 0.6, 1.0]), np.array([[3.0], [-2.0], [5.0], [1.0]])
    x, v, read = 0.0, 0.0, list[tuple[float, float]]()
    for duration, (push,) in zip(durations, forces, strict=True):
        last, decay = push / 0.7, math.exp(-0.7 * duration / 2.0)
        x, v = x + last * duration + (v - last) * 2.0 / 0.7 * (1 - decay), last + (v - last) * decay
        read.append((x, v))
    course = Course(durations, forces, np.array(read))
    course.readings[1] = np.nan

    def asked(structure: str, knobs: Knobs) -> AnswerValue:
        return float(60 / knobs["drag"] if structure == "linear" else math.sqrt(60 / knobs["drag"]))

    fits = members(laws, course, asked)
    assert fits["linear"].answer == pytest.approx(60 / 0.7, rel=1e-4)
    assert fits["linear"].chi_square < 0.1
    assert fits["linear"].readings == fits["square"].readings == 6
    assert surviving(fits) == ["linear"]
