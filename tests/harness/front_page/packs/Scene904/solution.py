"""Scene 904: halve the range of ramps until one is left."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
WATCH_S = 1.0
SLID_M = 0.005
STIRRED = 0.01
"""Momentum per kg [m/s] above the creep of a slider that holds, below the speed of one that slides."""


def _place(ramp):
    tilt = radians(9 + 3 * ramp)
    return {"x": RADIUS * sin(tilt), "y": ramp, "z": 1 + RADIUS * cos(tilt)}


def solve(task):
    """Set the slider down on the middle ramp of those left, at rest, and see whether it gains momentum."""
    low, high = 1, 12
    while low < high:
        ramp = (low + high) // 2
        readings = yield [
            call("move_object", object_id="object_1", **_place(ramp)),
            call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
            call("step", duration=WATCH_S),
            call("get_momentum", object_id="object_1", mass=1.0),
        ]
        if readings[-1]["momentum"]["x"] > STIRRED:
            high = ramp
        else:
            low = ramp + 1
    yield [answer(str(low))]


def theory(knobs):
    """The shallowest ramp with tan θ above μ."""
    return str(int(knobs["n"]))


def measure(engine, knobs):
    """Every ramp in turn in the engine, from the shallowest."""
    for ramp in range(1, 13):
        place = _place(ramp)
        engine.place("object_1", np.array([place["x"], place["y"], place["z"]]), {})
        engine.set_velocity("object_1", np.zeros(3))
        engine.step(engine.whole_steps(WATCH_S))
        if engine.pose("object_1").position[0] - place["x"] > SLID_M:
            return str(ramp)
    return "13"
