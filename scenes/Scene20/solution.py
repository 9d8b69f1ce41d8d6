"""Scene 20: let a light ball drift with the stream until nothing drives it, and read its energy."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

DRIFT_S = 20.0
STILL_DRIVEN = 1e-3
"""Net force on a kilogram [N] above which the ball has not reached the speed of the stream."""


def solve(task):
    """In the end the ball is as fast as the stream."""
    readings = yield [
        call("create_objects", name="float", pos=[0, 0, 1], density=50, rgba=[1, 0, 0, 1]),
        call("step", duration=DRIFT_S),
        call("compute_force", object_id="float", mass=1.0),
        call("get_kinetic_energy", object_id="float", mass=1.0),
    ]
    drive = max(abs(readings[2][axis]) for axis in "xyz")
    speed = sqrt(2 * readings[3]["kinetic_energy"])
    yield [answer(speed if drive < STILL_DRIVEN else "the ball still gains speed")]


def theory(knobs):
    """The speed that was drawn."""
    return knobs["speed"]


def measure(engine, knobs):
    """The drift of a heavier ball in the engine, after a longer time."""
    engine.add_ball("float", np.array([0.0, 0.0, 1.0]), 100.0, 0.1, np.ones(4), {})
    engine.step(engine.whole_steps(2 * DRIFT_S))
    return float(np.linalg.norm(engine.twist("float").linear))
