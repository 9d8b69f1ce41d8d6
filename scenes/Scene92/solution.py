"""Scene 92: a fresh ball at every trial, faster or slower, by whether the bob came up to the axle."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS, PROBE_KG = 0.1, 4.0
DENSITY = PROBE_KG / (4 / 3 * pi * RADIUS**3)
START = [-0.5, 0.0, 1.1]
AXLE_Z = 1.5
GAP_M = 0.3
SLOW, FAST = 1.0, 12.0
ROUNDS = 11
TOUCH_S = 0.25
"""By then the ball is past the first touch and, deep or not, has bounced off."""
LOOK_S, LOOKS = 0.02, 30
CALM_S = 30.0


def _strike(speed, name):
    """Send a ball off, take it away after the impact, follow the bob to its turn, and let it come to rest."""
    until_touch = GAP_M / speed
    whole = round((until_touch + TOUCH_S) / 0.005) * 0.005
    return [
        call("create_objects", name=name, pos=START, density=DENSITY, rgba=[0, 0, 1, 1], radius=RADIUS),
        call("set_velocity", object_id=name, velocity_vector=[speed, 0, 0]),
        call("step", duration=whole),
        call("delete_objects", object_id=name),
        *([call("step", duration=LOOK_S), call("get_position", object_id="object_1")] * LOOKS),
        call("step", duration=CALM_S),
    ]


def solve(task):
    """Halve the range of speeds in proportion."""
    slow, fast = SLOW, FAST
    for turn in range(ROUNDS):
        speed = sqrt(slow * fast)
        heights = [one["position"][2] for one in (yield _strike(speed, f"probe{turn}"))[5::2]]
        slow, fast = (slow, speed) if max(heights) > AXLE_Z else (speed, fast)
    yield [answer(sqrt(slow * fast))]


def measure(engine, knobs):
    """A finer search in the engine, with a fresh bob each time, followed step by step."""
    start, slow, fast = engine.save(), SLOW, FAST
    for _ in range(11):
        speed = sqrt(slow * fast)
        engine.restore(start)
        engine.add_ball("probe", np.array(START), DENSITY, RADIUS, np.ones(4), {})
        engine.set_velocity("probe", np.array([speed, 0.0, 0.0]))
        engine.step(engine.whole_steps(round((GAP_M / speed + TOUCH_S) / 0.005) * 0.005))
        engine.remove("probe")
        top = before = -1.0
        while top >= before:
            before = top
            engine.step(1)
            top = float(engine.pose("object_1").position[2])
        slow, fast = (slow, speed) if max(top, before) > AXLE_Z else (speed, fast)
    return sqrt(slow * fast)
