"""Scene 45: halve the range of masses by whether the second block has stirred."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
PAN_KG = 0.1
PAN_X = 3.0
LEAST, MOST = 0.45, 5.0
ROUNDS = 9
WATCH_S = 10.0
REST_S = 2.0
STIRRED_M = 5e-4


def _trial(name, pan_z, mass):
    """A ball put into the pan for a while, and where the second block and the pan are after it was taken away."""
    return [
        call("create_objects", name=name, pos=[PAN_X, 0, pan_z + RADIUS], density=mass / VOLUME, rgba=[1, 0, 0, 1]),
        call("step", duration=WATCH_S),
        call("delete_objects", object_id=name),
        call("step", duration=REST_S),
        call("get_displacement", object_id="object_2"),
        call("get_position", object_id="object_4"),
    ]


def solve(task):
    """Halve the range, in proportion."""
    pulled = yield [call("get_position", object_id="object_4")]
    low, high, pan_z, shift = LEAST, MOST, pulled[0]["position"][2], 0.0
    for number in range(ROUNDS):
        mass = sqrt(low * high)
        readings = yield _trial(f"ball{number}", pan_z, mass)
        before, shift, pan_z = shift, readings[-2]["displacement"], readings[-1]["position"][2]
        low, high = (low, mass) if shift - before > STIRRED_M else (mass, high)
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """The mass m with (m + 0.1 kg) g = f1 + f2."""
    return (knobs["f1"] + knobs["f2"]) / GRAVITY - PAN_KG


def measure(engine, knobs):
    """The same in the engine, finer, around the true mass, from the fresh blocks each time."""
    start, place = engine.save(), engine.pose("object_4").position + np.array([0.0, 0.0, RADIUS])
    low, high = 0.9 * theory(knobs), 1.1 * theory(knobs)
    for _ in range(7):
        mass = (low + high) / 2
        engine.restore(start)
        engine.add_ball("ball", place, mass / VOLUME, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        low, high = (low, mass) if engine.pose("object_2").position[0] + 1.0 > STIRRED_M else (mass, high)
    return (low + high) / 2
