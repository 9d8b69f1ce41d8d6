"""Scene 19: put exactly two kilograms into the empty pan and see where the ball comes to lie."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
DENSITY = 2.0 / (4 / 3 * pi * RADIUS**3)
PAN = [-0.5, 0.0, 1.0 + RADIUS]
LEVEL = 0.02
"""A ball this near to its place is in a level pan."""
REST_S = 10.0


def _verdict(lift):
    """The ball has gone up if the load is the heavier side."""
    return "0" if abs(lift) < LEVEL else "1" if lift > 0 else "2"


def solve(task):
    """The ball's height tells where its pan is."""
    readings = yield [
        call("create_objects", name="weight", pos=PAN, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=REST_S),
        call("get_position", object_id="weight"),
    ]
    yield [answer(_verdict(readings[-1]["position"][2] - PAN[2]))]


def theory(knobs):
    """The verdict that was drawn."""
    return str(knobs["verdict"])


def measure(engine, knobs):
    """The pan's own height in the engine."""
    engine.add_ball("weight", np.array(PAN), DENSITY, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(REST_S))
    return _verdict(engine.pose("object_1").position[2] - 1.0)
