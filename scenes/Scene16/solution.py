"""Scene 16: load the pan with a ball of known mass and read the sag."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
DENSITY = 500.0
WEIGHT_N = DENSITY * 4 / 3 * pi * RADIUS**3 * 9.81


def solve(task):
    """Put a ball into the pan, wait until both rest, check that it is inside, and divide its weight by the sag."""
    readings = yield [
        call("create_objects", name="weight", pos=[0, 0, 1.105], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=15),
        call("detect_collision", obj1_id="weight", obj2_id="object_1", elastic_response=False),
        call("get_displacement", object_id="object_1"),
    ]
    lies_in_the_pan = readings[2]["collision_detected"]
    yield [answer(WEIGHT_N / readings[-1]["displacement"] if lies_in_the_pan else "the ball is not in the pan")]


def theory(knobs):
    """The stiffness that was drawn."""
    return knobs["k"]


def measure(engine, knobs):
    """Weight over sag in the engine, after a longer rest."""
    start = engine.pose("object_1").position[2]
    place, colour = np.array([0.0, 0.0, 1.101]), np.ones(4)
    engine.add_ball("weight", place, DENSITY, RADIUS, colour, {})
    engine.step(engine.whole_steps(30.0))
    return float(WEIGHT_N / (start - engine.pose("object_1").position[2]))
