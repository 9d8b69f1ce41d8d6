"""Tests of the local law with which pushes are planned, fitted to exact or numerically integrated trajectories."""

import numpy as np
import pytest

from scenes.course_record import Course
from scenes.fitting import Array
from scenes.local_law import LocalLaw

MASS, SIGMA = 2.5, 0.002
TRUE = LocalLaw(1 / MASS, drag=0.6, turn=-0.9, other=(0.3, -0.2))


def _pushed(law: LocalLaw, forces: Array, spring: float = 0.0, duration: float = 0.4) -> Course:
    """Return the course of a puck that starts at rest, under these forces and those of a spring to the origin."""
    state, readings = np.zeros((4, 1)), list[Array]()
    for force in forces:
        near = LocalLaw(law.lightness, 0.0, law.drag, law.turn, tuple(np.array(law.other) - spring * state[:2, 0]))
        state = near.followed(state, law.lightness * force[:, None], duration)
        readings.append(state[:, 0])
    return Course(np.full(len(forces), duration), forces, np.array(readings))


FORCES = np.array([[1.0, 0.3], [1.0, 0.3], [-2.0, 1.0], [-2.0, 1.0], [3.0, -4.0], [3.0, -4.0], [0.0, 2.0], [0.0, 2.0]])


def test_the_constants_of_a_linear_law_are_found() -> None:
    found = LocalLaw.fitted(_pushed(TRUE, FORCES), SIGMA, 0.0, 0.1)
    assert found.lightness == pytest.approx(TRUE.lightness, rel=0.02)
    assert found.drag == pytest.approx(TRUE.drag, rel=0.05)
    assert found.turn == pytest.approx(TRUE.turn, rel=0.05)
    assert found.other == pytest.approx(TRUE.other, abs=0.02)


def test_a_force_that_depends_on_the_place_is_not_ascribed_to_the_mass() -> None:
    course = _pushed(
        LocalLaw(1 / MASS, drag=0.5), np.repeat([[2.0, 0.5], [4.0, 1.0], [8.0, 2.0]], 4, axis=0), spring=1.2
    )
    uniform, wandering = (LocalLaw.fitted(course, SIGMA, wanders, 0.3) for wanders in (0.0, 0.5))
    off = [abs(law.lightness * MASS - 1) for law in (uniform, wandering)]
    assert off[1] < 0.25
    assert off[0] > 2 * off[1]
    assert wandering.error > 10 * uniform.error
    assert wandering.other == pytest.approx(-1.2 * course.readings[-1, :2], rel=0.35)


def test_one_constant_push_does_not_tell_a_mass_from_a_force() -> None:
    law = LocalLaw.fitted(_pushed(TRUE, FORCES[:2]), SIGMA, 0.5, 0.1)
    assert law.error > TRUE.lightness


def test_a_puck_is_followed_to_its_last_speed_and_on_a_circle() -> None:
    slowed = LocalLaw(1.0, drag=2.0).followed(np.zeros((4, 2)), np.array([[1.0, 3.0], [0.0, 0.0]]), 8.0)
    assert slowed[2].tolist() == pytest.approx([0.5, 1.5], rel=1e-4)
    turned = LocalLaw(1.0, turn=2.0).followed(np.array([[0.0], [0.0], [1.0], [0.0]]), np.zeros((2, 1)), np.pi)
    assert turned[:, 0].tolist() == pytest.approx([0.0, 0.0, 1.0, 0.0], abs=1e-4)
    quarter = LocalLaw(1.0, turn=2.0).followed(np.array([[0.0], [0.0], [1.0], [0.0]]), np.zeros((2, 1)), np.pi / 4)
    assert quarter[3, 0] == pytest.approx(-1.0, abs=1e-4)
