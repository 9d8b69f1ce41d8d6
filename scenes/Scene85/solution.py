"""Scene 85: strike, see how far the slider comes, and correct the speed until it stops on the line."""

from math import log

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
START_X = -1.0
STRIKER_KG = 1.0
LINE = 3.0
REST_S = 15.0
"""Longer than any strike up to the line needs to come to rest."""
FIRST = 2.0
MOST = 9.0
ROUNDS = 9
NEAR = 0.005


def _strike(speed):
    """Both sliders back to their places, then one strike; how far object_2 came is what it was displaced."""
    return [
        call("move_object", object_id="object_2", x=0, y=0, z=RADIUS),
        call("set_velocity", object_id="object_2", velocity_vector=[0, 0, 0]),
        call("move_object", object_id="object_1", x=START_X, y=0, z=RADIUS),
        call("set_velocity", object_id="object_1", velocity_vector=[speed, 0, 0]),
        call("step", duration=REST_S),
        call("get_displacement", object_id="object_2"),
    ]


def solve(task):
    """Keep a speed that is too low and one that is too high, and go in between by the way it came."""
    low, near, high, far = 0.0, 0.0, MOST, None
    speed = FIRST
    for turn in range(ROUNDS):
        readings = yield _strike(speed)
        way = readings[-1]["displacement"]
        if abs(way - LINE) < NEAR:
            break
        if way < LINE:
            low, near = speed, way
        else:
            high, far = speed, way
        if far is None:
            speed = min(1.8 * speed, MOST)
        elif turn % 3 == 2:
            speed = (low + high) / 2
        else:
            speed = low + (LINE - near) / (far - near) * (high - low)
    yield [answer(speed)]


def theory(knobs):
    """On the smooth part the speed falls by gamma per metre; then x = v/γ - (μg/γ²) ln(1 + γv/(μg)) is left."""
    gamma, grip = knobs["gamma"], knobs["mu"] * GRAVITY
    low, high = 0.0, 50.0
    for _ in range(60):
        speed = (low + high) / 2
        left = speed / gamma - grip / gamma**2 * log(1 + gamma * speed / grip)
        low, high = (speed, high) if knobs["edge"] + left < LINE else (low, speed)
    struck = speed + gamma * knobs["edge"]
    return struck * (STRIKER_KG + knobs["m2"]) / (2 * STRIKER_KG)


def measure(engine, knobs):
    """The same speed by halving in the engine, with a striker that starts close by."""
    start = engine.save()
    low, high = 0.0, MOST
    for _ in range(12):
        speed = (low + high) / 2
        engine.restore(start)
        engine.place("object_1", np.array([-0.3, 0.0, RADIUS]), {})
        engine.set_velocity("object_1", np.array([speed, 0.0, 0.0]))
        engine.step(engine.whole_steps(REST_S))
        low, high = (speed, high) if engine.pose("object_2").position[0] < LINE else (low, speed)
    return (low + high) / 2
