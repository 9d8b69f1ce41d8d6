"""Scene 28: let the glider go from ever better places until its first rest falls on the asked moment."""

from math import atan2, exp, inf, log, pi, sqrt

import numpy as np

from scenes.protocol import answer, call

ASKED_S = 1.5
RAIL_Z = 1.0
NEAR, FAR = 0.04, 0.84
"""The glider is let go between these places [m]; at the nearest it touches no cord yet."""
ROUNDS = 14
LOOK_S = 0.25
"""No swing from one side to the other is shorter than this."""
LOOKS = round(ASKED_S / LOOK_S)


def solve(task):
    """A glider that comes back before the asked moment was let go too far out, one that still goes left too near."""
    low, high = NEAR, FAR
    for _ in range(ROUNDS):
        place = (low + high) / 2
        readings = yield [
            call("move_object", object_id="object_1", x=place, y=0, z=RAIL_Z),
            call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
            *LOOKS * [call("step", duration=LOOK_S), call("get_momentum", object_id="object_1", mass=1.0)],
        ]
        if any(reading["momentum"]["x"] > 0 for reading in readings[3::2]):
            high = place
        else:
            low = place
    yield [answer((low + high) / 2)]


def _first_rest(start, knobs):
    """When a glider let go at `start` is at rest on the far side; infinity if it never gets to a rest there.

    Right cord: a damped quarter swing to the slack; slack: coasting; left cord: damped until the speed is nought.
    """
    drag = knobs["c"] / knobs["m"]
    stretch = start - knobs["right"]
    if stretch <= 0:
        return inf
    spring = knobs["k_right"] / knobs["m"]
    half, rate = drag / 2, sqrt(spring - drag**2 / 4)
    first = (pi / 2 + atan2(half, rate)) / rate
    speed = stretch * sqrt(spring) * exp(-half * first)
    gap = knobs["left"] + knobs["right"]
    if drag * gap >= speed:
        return inf
    second = -log(1 - drag * gap / speed) / drag
    rate = sqrt(knobs["k_left"] / knobs["m"] - drag**2 / 4)
    return first + second + atan2(rate, half) / rate


def theory(knobs):
    """The start at which the three times add up to the asked one: they shrink as the start moves out."""
    low, high = 0.0, 2.0
    for _ in range(50):
        place = (low + high) / 2
        low, high = (low, place) if _first_rest(place, knobs) < ASKED_S else (place, high)
    return (low + high) / 2


def measure(engine, knobs):
    """The same search in the engine, finer."""
    start = engine.save()
    low, high = NEAR, FAR
    for _ in range(17):
        place = (low + high) / 2
        engine.restore(start)
        engine.place("object_1", np.array([place, 0.0, RAIL_Z]), {})
        back = False
        for _ in range(LOOKS):
            engine.step(engine.whole_steps(LOOK_S))
            back = back or engine.twist("object_1").linear[0] > 0
        if back:
            high = place
        else:
            low = place
    return (low + high) / 2
