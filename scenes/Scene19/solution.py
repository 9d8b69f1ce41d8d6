"""Scene 19: put exactly two kilograms into the empty pan and see whether they go up or down."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
BALL_KG = 2.0
GRAVITY = 9.81
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
PAN = [-0.5, 0.0, 1.0 + RADIUS]
LEVEL = 0.02
"""A ball this near to its place is in a level pan."""
REST_S = 10.0


def _verdict(lift):
    """The ball has gone up if the load is the heavier side."""
    return "0" if abs(lift) < LEVEL else "1" if lift > 0 else "2"


def solve(task):
    """As long as it lies in the pan, the ball's gain in potential energy tells how far its pan has gone up."""
    height = call("get_potential_energy", object_id="weight", mass=BALL_KG, gravity=GRAVITY)
    readings = yield [
        call("create_objects", name="weight", pos=PAN, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        height,
        call("step", duration=REST_S),
        call("detect_collision", obj1_id="weight", obj2_id="object_1", elastic_response=False),
        height,
    ]
    lies_in_the_pan = readings[3]["collision_detected"]
    lift = (readings[4]["potential_energy"] - readings[1]["potential_energy"]) / (BALL_KG * GRAVITY)
    yield [answer(_verdict(lift) if lies_in_the_pan else "the ball is not in the pan")]


def theory(knobs):
    """The verdict that was drawn."""
    return str(knobs["verdict"])


def measure(engine, knobs):
    """The pan's own height in the engine."""
    engine.add_ball("weight", np.array(PAN), DENSITY, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(REST_S))
    return _verdict(engine.pose("object_1").position[2] - 1.0)
