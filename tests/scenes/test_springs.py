"""Tests of spring laws: force and energy agree, and each kind is identified from its own forces."""

import numpy as np
import pytest
from scipy.integrate import quad

from scenes.family import surviving
from scenes.fitting import Array
from scenes.springs import KINDS, best, drawn, drawn_kinds, energy, fitted, members, next_load, pull, resisted, stretch

LAWS = {"even": (50.0,), "cubic": (50.0, 50.0 / 0.3**2), "late": (50.0, 75.0, 0.2123)}
STRETCHES = np.array([0.03, 0.06, 0.1, 0.14, 0.18, 0.2, 0.22, 0.24, 0.26, 0.28, 0.29])


def _points(kind: str) -> list[tuple[float, float]]:
    return [(u, float(pull(u, *LAWS[kind]))) for u in STRETCHES.tolist()]


@pytest.mark.parametrize("kind", KINDS)
def test_the_energy_of_a_spring_is_the_integral_of_its_pull(kind: str) -> None:
    integral = quad(lambda u: float(pull(u, *LAWS[kind])), 0.0, 0.9, points=[0.2123])[0]
    assert energy(0.9, *LAWS[kind]) == pytest.approx(integral, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_spring_is_recovered_from_its_own_forces(kind: str) -> None:
    cost, law = fitted(_points(kind), kind)
    assert law == pytest.approx(LAWS[kind], rel=1e-3)
    assert cost < 0.1
    assert best(_points(kind), 1.0) == pytest.approx(LAWS[kind], rel=1e-3)


def test_a_single_point_gives_the_stiffness_that_is_assumed() -> None:
    assert best(_points("even")[:1], 30.0) == (30.0,)


def test_drawn_laws_follow_from_the_drawn_values() -> None:
    knobs = {"kinds": "cubic, late", "k1": 40.0, "w1": 0.5, "k2": 20.0, "q2": 1.5, "s2": 0.22}
    assert drawn(knobs, 1) == (40.0, 160.0)
    assert drawn(knobs, 2) == (20.0, 30.0, 0.22)
    assert drawn_kinds(knobs) == "cubic, late"
    assert drawn({"kinds": "even, late", "k1": 40.0}, 1) == (40.0,)


def test_the_next_load_follows_the_last_slope_to_the_next_goal() -> None:
    rows, goals = [(0.0, 0.0), (0.05, 2.0), (0.1, 5.0)], (0.06, 0.104, 0.2)
    assert next_load(rows, goals) == (0.2, pytest.approx(5.0 + 60.0 * 0.1))
    assert next_load(rows, goals[:2]) is None


def test_a_resistance_with_an_edge_is_recovered() -> None:
    spin = np.array([1.5, 2.5, 4.5, 5.5, 6.5, 7.0, 7.6, 8.1, 8.6, 9.4])

    def columns(edge: float) -> list[Array]:
        return [spin, np.maximum(spin - edge, 0.0)]

    cost, found, edge = resisted(columns, spin, 2.0 * spin + 3.0 * np.maximum(spin - 6.73, 0.0))
    assert (*found, edge) == pytest.approx((2.0, 3.0, 6.73), rel=1e-4)
    assert cost < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_the_stretch_under_a_pull_is_the_inverse_of_the_pull(kind: str) -> None:
    assert stretch(pull(STRETCHES, *LAWS[kind]), *LAWS[kind]) == pytest.approx(STRETCHES, rel=1e-9)


@pytest.mark.parametrize("kinds", [("late", "cubic"), ("even", "late"), ("cubic", "even")])
def test_only_the_kinds_of_the_springs_fit_their_stretches(kinds: tuple[str, str]) -> None:
    fits = members([_points(kind) for kind in kinds], lambda laws: sum(energy(0.9, *law) for law in laws), 8e-5)
    assert len(fits) == len(KINDS) ** 2
    assert surviving(fits) == [", ".join(kinds)]
    fit = fits[", ".join(kinds)]
    key = sum(energy(0.9, *LAWS[kind]) for kind in kinds)
    assert fit.answer == pytest.approx(key, rel=1e-3)
    assert fit.plausible(40) == pytest.approx([key] * 40, rel=0.05)
