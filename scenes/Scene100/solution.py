"""Scene 100: halve the row; a block that passes its rest is damped too little."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

PULL_M = 0.5
WATCH = 12.0
"""How long a block is watched, in units of one over its natural rate."""
LOOKS = 40
STEP_S = 0.005
FIRST, LAST = 2, 6


def _pull(block):
    return call("change_position", object_id=block, dx=PULL_M, dy=0, dz=0)


def solve(task):
    """The first acceleration from rest gives the natural rate, and with it how long to watch; then halve the row."""
    found = yield [call("find_objects")]
    blocks = [one["object_id"] for one in found[0]["revealed"]]
    readings = yield [_pull(blocks[-1]), call("step", duration=STEP_S), call("get_acceleration", object_id=blocks[-1])]
    rate = sqrt(-readings[-1]["x"] / PULL_M)
    low, high = FIRST, LAST
    while low < high:
        middle = (low + high) // 2
        block = blocks[middle - 1]
        look = [call("step", duration=WATCH / rate / LOOKS), call("get_position", object_id=block)]
        readings = yield [_pull(block), *(look * LOOKS)]
        passed = any(reading["position"][0] < 0 for reading in readings[2::2])
        low, high = (middle + 1, high) if passed else (low, middle)
    yield [answer(str(low))]


def theory(knobs):
    """The number that was drawn."""
    return str(knobs["number"])


def measure(engine, knobs):
    """All blocks at once in the engine."""
    bodies = [f"object_{number + 1}" for number in range(1, 8)]
    for body in bodies:
        engine.place(body, engine.pose(body).position + np.array([PULL_M, 0.0, 0.0]), {})
    passed = dict.fromkeys(bodies, False)
    for _ in range(engine.whole_steps(2 * WATCH / knobs["rate"])):
        engine.step(1)
        for body in bodies:
            passed[body] |= bool(engine.pose(body).position[0] < 0)
    return str(1 + list(passed.values()).index(False))
