"""Tests that the true laws used by the grader predict the same motion as the engine."""

from dataclasses import replace

import numpy as np
import pytest

from evaluator.answers.engine import Engine
from evaluator.answers.keys import KeyRing
from evaluator.answers.laws import TrueLaw, courses_of
from scenes import Category, list_packs, one_world, read_pack, reference_of
from scenes.finding import model_without_walls
from scenes.law_statements import CATCH

OPEN = [files.scene_id for files in list_packs() if read_pack(files).category is Category.OPEN]
WORLDS = [one_world(f"world:{level}:{index}") for level, index in ((1, 0), (3, 1), (5, 0), (7, 0), (8, 1))]
RING = KeyRing()
STEP_S = 0.25


def law_of(scene: int) -> TrueLaw:
    found = RING.law(scene, 3)
    assert found is not None
    return found


def read(engine: Engine, true: TrueLaw) -> list[float]:
    """Return positions, then velocities, of all coordinates in the engine."""
    places, speeds = list[float](), list[float]()
    for body, axis, _ in true.model.coordinates:
        turned = engine.turn(body)
        if axis == "angle":
            assert turned is not None
            places.append(turned.angle)
            speeds.append(turned.spin)
        else:
            at = "xyz".index(axis)
            places.append(float(engine.pose(body).position[at]))
            speeds.append(float(engine.velocity(body)[at]))
    return [*places, *speeds]


def put(engine: Engine, true: TrueLaw, places: list[float], speeds: list[float]) -> None:
    """Set positions and velocities of the objects in the engine."""
    for body in true.objects:
        place, velocity = engine.pose(body).position.copy(), np.zeros(3)
        for (name, axis, _), x, v in zip(true.model.coordinates, places, speeds, strict=True):
            if name == body and axis != "angle":
                place["xyz".index(axis)], velocity["xyz".index(axis)] = x, v
        if any(name == body and axis != "angle" for name, axis, _ in true.model.coordinates):
            engine.place(body, place, {})
            engine.set_velocity(body, velocity)


def push(engine: Engine, true: TrueLaw, loads: list[float]) -> None:
    """Apply loads to the objects of the engine."""
    for body in true.objects:
        force, torque = np.zeros(3), np.zeros(3)
        for (name, axis, _), load in zip(true.model.coordinates, loads, strict=True):
            if name == body and axis == "angle":
                torque[2] = load
            elif name == body:
                force["xyz".index(axis)] = load
        engine.push(body, force, torque)


def test_every_open_world_asks_for_a_law() -> None:
    assert len(OPEN) == 20
    assert RING.law(7, 0) is None


@pytest.mark.parametrize("scene", [*OPEN, *WORLDS], ids=reference_of)
def test_the_engine_moves_bodies_by_the_law_that_grades_compare_with(scene: int) -> None:
    true = law_of(scene)
    course = courses_of(true, far=False)[2]
    turns = any(axis == "angle" for _, axis, _ in true.model.coordinates)  # `put` cannot set an angle
    if turns:
        course = replace(course, places=[0.0], speeds=[0.0])
    looks = true.motion.followed(course)
    assert looks is not None
    engine, seen = Engine(model_without_walls(scene, 3)), list[list[float]]()
    if CATCH in engine.bodies:  # this switches the catch off, as in the questions
        engine.place(CATCH, np.array([0.0, 0.0, 1.0]), {})
    put(engine, true, course.places, course.speeds)
    for loads in course.loads:
        push(engine, true, loads)
        for _ in range(len(looks) // len(course.loads)):
            engine.step(engine.whole_steps(STEP_S))
            seen.append(read(engine, true))
    size = float(np.abs(seen).max())
    assert np.array(seen) == pytest.approx(np.array(looks), abs=2e-4 * size)
