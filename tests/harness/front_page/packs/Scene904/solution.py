"""Scene 904: find the shallowest ramp on which the slider slides, by bisection."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
WATCH_S = 1.0
SLID_M = 0.005
STIRRED = 0.01
"""Threshold of momentum per kg [m/s]: above the creep of a slider at rest, below the speed of a sliding one."""


def _place(ramp):
    tilt = radians(9 + 3 * ramp)
    return {"x": RADIUS * sin(tilt), "y": ramp, "z": 1 + RADIUS * cos(tilt)}


def solve(task):
    """Place the slider at rest on the middle one of the possible ramps, and test whether it gains momentum."""
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
    """Try every ramp in the engine, from the shallowest."""
    for ramp in range(1, 13):
        place = _place(ramp)
        engine.place("object_1", np.array([place["x"], place["y"], place["z"]]), {})
        engine.set_velocity("object_1", np.zeros(3))
        engine.step(engine.whole_steps(WATCH_S))
        if engine.pose("object_1").position[0] - place["x"] > SLID_M:
            return str(ramp)
    return "13"
