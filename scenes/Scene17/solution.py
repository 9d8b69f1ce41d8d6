"""Scene 17: let a ball roll; its momentum points straight down the slope."""

from math import atan2, degrees, hypot

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
SETTLE_S, ROLL_S = 1.0, 3.0


def solve(task):
    """Once the ball has come to roll, the dip of its momentum is that of the floor."""
    readings = yield [
        call("create_objects", name="ball", pos=[0, 0, 0.15], density=1000, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=ROLL_S),
        call("detect_collision", obj1_id="ball", obj2_id="object_1", elastic_response=False),
        call("get_momentum", object_id="ball", mass=1.0),
    ]
    on_the_floor, momentum = readings[2]["collision_detected"], readings[3]["momentum"]
    dip = degrees(atan2(-momentum["z"], hypot(momentum["x"], momentum["y"])))
    yield [answer(dip if on_the_floor else "the ball is not on the floor")]


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
