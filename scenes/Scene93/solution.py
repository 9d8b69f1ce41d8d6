"""Scene 93: keep a height that is too small and one that is too great, and drop from in between."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS, PROBE_KG = 0.1, 4.0
DENSITY = PROBE_KG / (4 / 3 * pi * RADIUS**3)
PAN_Z, PLATE_M = 1.0, 0.05
WANTED_M = 0.15
LEAST, MOST = 0.03, 4.0
ROUNDS = 9
LOOK_S, LOOKS = 0.01, 50
CALM_S = 20.0
GRAVITY = 9.81


def _drop(height, name):
    """Create a ball at a height, wait until it meets the pan, follow the pan, take the ball away and wait."""
    fall = max(round(sqrt(2 * height / GRAVITY) / 0.005), 1) * 0.005
    return [
        call(
            "create_objects",
            name=name,
            pos=[0, 0, PAN_Z + height + RADIUS],
            density=DENSITY,
            rgba=[1, 0, 0, 1],
            radius=RADIUS,
        ),
        call("step", duration=fall),
        *([call("step", duration=LOOK_S), call("get_position", object_id="object_1")] * LOOKS),
        call("delete_objects", object_id=name),
        call("step", duration=CALM_S),
    ]


def _lowest(readings):
    """Depth of the first turn, from the parabola through the three looks around it."""
    depths = [PAN_Z - PLATE_M - one["position"][2] for one in readings[3:-2:2]]
    turn = next(at for at in range(1, len(depths) - 1) if depths[at] >= max(depths[at - 1], depths[at + 1], 0.01))
    before, top, after = depths[turn - 1 : turn + 2]
    return top - (before - after) ** 2 / (8 * (before - 2 * top + after))


def solve(task):
    """Halve the range of heights in proportion."""
    low, high = LEAST, MOST
    for turn in range(ROUNDS):
        height = sqrt(low * high)
        low, high = (low, height) if _lowest((yield _drop(height, f"weight{turn}"))) > WANTED_M else (height, high)
    yield [answer(sqrt(low * high))]


def measure(engine, knobs):
    """A finer search in the engine, with a pan at rest each time, followed step by step."""
    start, low, high = engine.save(), LEAST, MOST
    for _ in range(11):
        height = sqrt(low * high)
        engine.restore(start)
        engine.add_ball("weight", np.array([0, 0, PAN_Z + height + RADIUS]), DENSITY, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(max(round(sqrt(2 * height / GRAVITY) / 0.005), 1) * 0.005))
        depths = [0.0]
        for _ in range(engine.whole_steps(LOOKS * LOOK_S)):
            engine.step(1)
            depths.append(PAN_Z - PLATE_M - float(engine.pose("object_1").position[2]))
        low, high = (low, height) if max(depths) > WANTED_M else (height, high)
    return sqrt(low * high)
