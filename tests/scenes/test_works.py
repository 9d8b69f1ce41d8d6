"""Tests of potentials computed from positions, speeds and work: their points, correlated errors, travel times."""

from math import pi
from typing import Any

import numpy as np
import pytest

from scenes.course_record import force, position, velocity
from scenes.family import scattered, surviving
from scenes.fitting import Array
from scenes.protocol import Call
from scenes.rigs import Rig
from scenes.works import Refit, cheapest, guesses, parts_of_way, refitted, weighed, whitening, work_points

STIFFNESS = 5.0
RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], decimals=6)


def _fit(chi_square: float, constants: list[float], free: list[int]) -> Refit:
    """Return a fit with given constants and chi-square to two points; its residuals are always 0."""
    size = len(free)
    return Refit(chi_square, np.array(constants), free, lambda _: np.zeros(2), np.ones(size), np.full(size, 10.0))


def _swung(pushes: list[float]) -> list[tuple[Call, dict[str, Any]]]:
    """Return the motion of a body of 1 kg on a spring under pushes of 0.6 s, in closed form."""
    seen: list[tuple[Call, dict[str, Any]]] = []
    turn, x, v = STIFFNESS**0.5, 0.0, 0.0
    for push in pushes:
        for asked in RIG.leg(push, 0.6, looks=2):
            if asked.tool == "step":
                rest, angle = push / STIFFNESS, turn * asked.arguments["duration"]
                x, v = (
                    rest + (x - rest) * np.cos(angle) + v / turn * np.sin(angle),
                    v * np.cos(angle) - turn * (x - rest) * np.sin(angle),
                )
            read = {"get_position": {"position": [x, 0, 0]}, "get_velocity": {"velocity": [v, 0, 0]}}
            seen.append((asked, read.get(asked.tool, {"status": "done"})))
    return seen


def test_work_less_kinetic_energy_is_the_potential() -> None:
    place, speed, work, push, doubt = work_points(_swung([1.0, -1.0, 1.5]), RIG, 0.01, 9.0)
    assert work - speed**2 / 2 == pytest.approx(STIFFNESS * place**2 / 2, abs=1e-12)
    assert push.tolist() == [1.0, 1.0, -1.0, -1.0, 1.5, 1.5]
    assert doubt == pytest.approx(np.array([1.0, 1.0, 5.0, 5.0, 11.25, 11.25]) * 1e-4)


def test_points_end_where_a_latch_holds_the_body() -> None:
    seen = _swung([1.0, -1.0, 8.0, -8.0, 1.0])
    within = abs(seen[2][1]["position"][0]) * 3
    place = work_points(seen, RIG, 0.01, within)[0]
    assert 0 < len(place) < 10
    assert (abs(place) <= within).all()
    assert work_points([], RIG, 0.01, 1.0).tolist() == [[0.0]] * 5


def test_whitened_errors_are_independent_and_of_size_one() -> None:
    doubt, alone = np.array([0.0, 1.0, 1.0, 4.0]), np.array([1.0, 0.5, 2.0, 1.0])
    white = whitening(doubt, alone)
    errors = np.minimum.outer(doubt, doubt) + np.diag(alone)
    assert white @ errors @ white.T == pytest.approx(np.eye(4), abs=1e-12)


def test_a_stiffness_is_fitted_and_constants_that_are_not_free_stay() -> None:
    place, speed, work, _, doubt = work_points(_swung([1.0, -1.0, 1.5]), RIG, 0.001, 9.0)

    def misfits(p: Array) -> tuple[Array, Array]:
        return p[0] * place**2 / 2 + p[1] - (work - speed**2 / 2), np.zeros(0)

    fit = refitted(
        [np.array([1.0, 0.0]), np.array([9.0, 0.0])],
        [0],
        doubt,
        lambda _: np.full(len(place), 1e-6),
        misfits,
        np.array([1.0, 1.0]),
        np.array([50.0, 50.0]),
        1e-9,
    )
    white = whitening(doubt, np.full(len(place), 1e-6))
    assert fit.constants == pytest.approx([STIFFNESS, 0.0], rel=1e-6)
    assert fit.chi_square == pytest.approx(-2 * np.log(np.diag(white)).sum())
    drawn = fit.plausible(4000)
    assert drawn[:, 0].tolist() == fit.constants.tolist()
    assert not drawn[1].any()
    assert np.std(drawn[0, 1:]) == pytest.approx(1 / np.linalg.norm(white @ place**2 / 2), rel=0.05)


def test_springs_begin_at_each_place_and_absent_ones_stay_absent() -> None:
    starts = guesses(np.array([6.0, 0.5, 15.0, 0.5]), [0, 1], [1, 3], [0.3, 0.7])
    assert [start.tolist() for start in starts] == [[6.0, 0.3, 0.0, 0.0], [6.0, 0.7, 0.0, 0.0]]


def test_constants_of_which_nothing_is_known_are_drawn_over_their_usual_size_within_their_bounds() -> None:
    drawn = _fit(0.0, [0.5, 3.0, 8.0], [0, 2]).plausible(400)
    assert 0.0 < drawn[0].min() < 0.05
    assert drawn[1].tolist() == [3.0] * 401
    assert drawn[2].max() <= 10.0
    assert 0.8 < np.std(drawn[2]) <= 1.0


def test_no_draw_contradicts_the_points_where_only_the_linearisation_allows_it() -> None:
    """A cord that engages at b pulls k (1 - b) at 1 m; linear least squares restrict k and b only along a line."""
    error = 0.05

    def misfits(p: Array) -> Array:
        return np.array([p[0] * max(1 - p[1], 0.0) - 2.0]) / error

    fit = Refit(0.0, np.array([4.0, 0.5]), [0, 1], misfits, np.array([4.0, 0.5]), np.array([20.0, 0.9]))
    drawn = fit.plausible(200)
    linear = fit.constants + scattered(np.array([[2.0, -2.0]]) / error, 200) * fit.scale
    assert max(abs(misfits(p)[0]) for p in linear) > 8
    assert drawn.shape == (2, 201)
    assert np.ptp(drawn[1]) > 0.2
    assert max(abs(misfits(p)[0]) for p in drawn.T) < 4


def test_fewer_plausible_constants_are_returned_rather_than_some_outside_their_bounds() -> None:
    fit = Refit(0.0, np.array([0.0]), [0], lambda p: (p + 8.0) / 0.5, np.array([1.0]), np.array([1e-4]))
    drawn = fit.plausible(200)
    assert 1 <= drawn.shape[1] < 201
    assert ((drawn >= 0) & (drawn <= 1e-4)).all()


def test_each_constant_costs_the_logarithm_of_the_number_of_points() -> None:
    fits = {"one": _fit(10.0, [1.0, 0.0], [0]), "two": _fit(6.0, [1.0, 2.0], [0, 1])}
    assert cheapest(fits, 20) is fits["two"]
    assert cheapest(fits, 100) is fits["one"]


def test_the_time_of_a_half_swing_between_its_turning_points() -> None:
    def speed_at(x: Array) -> Array:
        return np.sqrt(np.maximum(STIFFNESS * (0.3**2 - x**2), 1e-12))

    parts, places = parts_of_way(speed_at, 0.3, -0.3)
    assert parts.sum() == pytest.approx(pi / STIFFNESS**0.5, rel=1e-3)
    assert places[0] > places[-1]
    assert len(places) == 400


def test_structures_are_weighed_on_the_same_points_with_the_same_errors() -> None:
    """The points are x²: a spring fits, a spring with an x⁴ part fits with factor 0, and x⁴ alone does not fit."""
    places, error = np.linspace(-1.0, 1.0, 21), 0.01
    energies = 2.0 * places**2 + error * np.random.default_rng(1).standard_normal(len(places))
    found = weighed(
        {"spring": _fit(0, [1.0, 0.0], [0]), "both": _fit(0, [1.0, 1.0], [0, 1]), "stiff": _fit(0, [0.0, 1.0], [1])},
        np.eye(len(places)) / error,
        lambda constants: constants[0] * places**2 + constants[1] * places**4 - energies,
        lambda constants: float(4 * constants[0] + 16 * constants[1]),
        np.array([10.0, 10.0]),
    )
    assert {name: member.constants for name, member in found.items()} == {"spring": 1, "both": 2, "stiff": 1}
    assert {member.readings for member in found.values()} == {len(places)}
    assert set(surviving(found)) == {"spring", "both"}
    assert found["spring"].answer == pytest.approx(8.0, rel=0.01)
