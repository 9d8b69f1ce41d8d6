"""Scene 20: let a light ball drift with the stream."""

from math import hypot

import numpy as np

from scenes.protocol import answer, call

DRIFT_S = 20.0


def solve(task):
    """In the end the ball is as fast as the stream."""
    readings = yield [
        call("create_objects", name="float", pos=[0, 0, 1], density=50, rgba=[1, 0, 0, 1]),
        call("step", duration=DRIFT_S),
        call("get_velocity", object_id="float"),
    ]
    vx, vy, _ = readings[-1]["velocity"]
    yield [answer(hypot(vx, vy))]


def theory(knobs):
    """The speed that was drawn."""
    return knobs["speed"]


def measure(engine, knobs):
    """The drift of a heavier ball in the engine, after a longer time."""
    engine.add_ball("float", np.array([0.0, 0.0, 1.0]), 100.0, 0.1, np.ones(4), {})
    engine.step(engine.whole_steps(2 * DRIFT_S))
    return float(np.linalg.norm(engine.twist("float").linear))
