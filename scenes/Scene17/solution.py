"""Scene 17: let a ball roll, and compare its drop with its run."""

from math import atan2, degrees, hypot

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
SETTLE_S, ROLL_S = 1.0, 2.0


def solve(task):
    """Between two looks the ball goes straight down the slope."""
    readings = yield [
        call("create_objects", name="ball", pos=[0, 0, 0.15], density=1000, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=SETTLE_S),
        call("get_position", object_id="ball"),
        call("step", duration=ROLL_S),
        call("get_position", object_id="ball"),
    ]
    (x0, y0, z0), (x1, y1, z1) = readings[2]["position"], readings[4]["position"]
    yield [answer(degrees(atan2(z0 - z1, hypot(x1 - x0, y1 - y0))))]


def theory(knobs):
    """The angle that was drawn."""
    return knobs["tilt"]


def measure(engine, knobs):
    """From the acceleration of the rolling ball in the engine, 5/7 of g sin θ."""
    engine.add_ball("ball", np.array([0.0, 0.0, 0.11]), 1000.0, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(SETTLE_S))
    before = engine.twist("ball").linear
    engine.step(engine.whole_steps(ROLL_S))
    gained = float(np.linalg.norm(engine.twist("ball").linear - before)) / ROLL_S
    return degrees(np.arcsin(gained / (5 / 7 * 9.81)))
