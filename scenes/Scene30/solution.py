"""Scene 30: launch from the bottom faster or slower, by whether the ball came over the top."""

from math import pi, sin, sqrt

import numpy as np

from scenes.protocol import answer, call

ROD = 1.0
AXIS_Z = 2.0
BOTTOM = {"x": 0, "y": 0, "z": AXIS_Z - ROD}
SLOW, FAST = 2.0, 15.0
ROUNDS = 13
LOOK_S = 0.1
"""The ball cannot go round a quarter in this time."""
LOOKS = 40


def _over(places):
    """Whether the ball, launched towards +x, came to the side of -x above the axis, and not first below it."""
    beyond = [z for x, _, z in places if x < 0]
    return bool(beyond) and beyond[0] > AXIS_Z


def solve(task):
    """Every round launches the ball from the bottom once and looks where it goes."""
    low, high = SLOW, FAST
    for _ in range(ROUNDS):
        speed = sqrt(low * high)
        readings = yield [
            call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
            call("move_object", object_id="object_1", **BOTTOM),
            call("set_velocity", object_id="object_1", velocity_vector=[speed, 0, 0]),
            *LOOKS * [call("step", duration=LOOK_S), call("get_position", object_id="object_1")],
        ]
        if _over([reading["position"] for reading in readings[4::2]]):
            high = speed
        else:
            low = speed
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """Follow the launch that just dies out at the top back down to the bottom.

    With x the angle from the top and w = |x'|: w dw/dx = (g / L) sin x + a w, from the unstable rest,
    near which w = r x with r² = g / L + a r.
    """
    pull, slow = knobs["g"] / ROD, knobs["drag"]

    def slope(x, w):
        return pull * sin(x) / w + slow

    steps = 400
    x = 0.01
    w = x * (slow + sqrt(slow**2 + 4 * pull)) / 2
    h = (pi - x) / steps
    for _ in range(steps):
        first = slope(x, w)
        second = slope(x + h / 2, w + h / 2 * first)
        third = slope(x + h / 2, w + h / 2 * second)
        fourth = slope(x + h, w + h * third)
        w += h / 6 * (first + 2 * second + 2 * third + fourth)
        x += h
    return ROD * w


def measure(engine, knobs):
    """The same search in the engine, each time from the same rest."""
    start = engine.save()
    low, high = SLOW, FAST
    for _ in range(14):
        speed = sqrt(low * high)
        engine.restore(start)
        engine.set_velocity("object_1", np.array([speed, 0.0, 0.0]))
        places = []
        for _ in range(LOOKS):
            engine.step(engine.whole_steps(LOOK_S))
            places.append(engine.pose("object_1").position)
            if places[-1][0] < 0:
                break
        over = _over(places)
        low, high = (low, speed) if over else (speed, high)
    return sqrt(low * high)
