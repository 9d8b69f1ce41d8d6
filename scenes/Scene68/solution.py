"""Scene 68: set the ball into the basket and see how fast it gains speed."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
BALL_KG, BASKET_KG = 2.0, 0.3
RADIUS = 0.1
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
RUN_S = 1.0
PLACE = [0.0, 0.0, 10.0 + RADIUS]


def solve(task):
    """Ball and basket come down with a = v / t; the rope carries what is missing from their weight."""
    readings = yield [
        call("create_objects", name="load", pos=PLACE, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=RUN_S),
        call("get_velocity", object_id="load"),
    ]
    gained = -readings[-1]["velocity"][2] / RUN_S
    yield [answer((BALL_KG + BASKET_KG) * (GRAVITY - gained))]


def theory(knobs):
    """Tension T = 2 M c g / (M + c) with M of ball and basket, c of the counterweight."""
    down = BALL_KG + BASKET_KG
    return 2 * down * knobs["counter"] * GRAVITY / (down + knobs["counter"])


def measure(engine, knobs):
    """Tension T = c (g + a), from the engine's counterweight between half a second and a second."""
    engine.add_ball("load", np.array(PLACE), DENSITY, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(RUN_S / 2))
    before = engine.twist("counterweight").linear[2]
    engine.step(engine.whole_steps(RUN_S / 2))
    gained = (engine.twist("counterweight").linear[2] - before) / (RUN_S / 2)
    return float(knobs["counter"] * (GRAVITY + gained))
