"""Scene 18: send a ball of one kilogram against the glider; momentum weighs it."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
BALL_KG = 1.0
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
SPEED = 2.0
START = [-1.0, 0.0, 1.0]


def solve(task):
    """The ball comes back or follows; in either case both velocities are told after the hit."""
    readings = yield [
        call("create_objects", name="ball", pos=START, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("set_velocity", object_id="ball", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=1.0),
        call("get_momentum", object_id="ball", mass=BALL_KG),
        call("get_velocity", object_id="object_1"),
    ]
    given = BALL_KG * SPEED - readings[-2]["momentum"]["x"]
    yield [answer(given / readings[-1]["velocity"][0])]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The same in the engine, at another speed and with another ball."""
    engine.add_ball("ball", np.array(START), 2 * DENSITY, RADIUS, np.ones(4), {})
    engine.set_velocity("ball", np.array([1.5, 0.0, 0.0]))
    engine.step(engine.whole_steps(2.0))
    given = 2 * BALL_KG * (1.5 - engine.twist("ball").linear[0])
    return float(given / engine.twist("object_1").linear[0])
