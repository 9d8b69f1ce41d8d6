"""Scene 33: halve the range of speeds by whether the puck comes closer or goes farther out."""

from math import hypot, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.8
START = {"x": RADIUS, "y": 0, "z": 1}
HUNG = {"x": 0, "y": 0, "z": 0.2}
SLOW, FAST = 0.5, 12.0
ROUNDS = 12
LOOK_S = 0.25


def _trial(speed):
    """Put both back at rest, send the puck off across the string, and look where it is a moment later."""
    still = [0, 0, 0]
    return [
        call("move_object", object_id="object_1", **START),
        call("move_object", object_id="object_2", **HUNG),
        call("set_velocity", object_id="object_2", velocity_vector=still),
        call("set_velocity", object_id="object_1", velocity_vector=[0, speed, 0]),
        call("step", duration=LOOK_S),
        call("get_position", object_id="object_1"),
    ]


def solve(task):
    """Too fast and the puck goes out, too slow and it comes in."""
    slow, fast = SLOW, FAST
    for _ in range(ROUNDS):
        speed = sqrt(slow * fast)
        x, y, _ = (yield _trial(speed))[-1]["position"]
        slow, fast = (slow, speed) if hypot(x, y) > RADIUS else (speed, fast)
    yield [answer(sqrt(slow * fast))]


def theory(knobs):
    """The pull per mass of the puck, weight and line, is v² / r."""
    return sqrt(RADIUS * (knobs["ratio"] * GRAVITY + knobs["pull"]))


def measure(engine, knobs):
    """A finer search in the engine, with a longer look."""
    start, low, high = engine.save(), SLOW, FAST
    for _ in range(16):
        speed = sqrt(low * high)
        engine.restore(start)
        engine.set_velocity("object_1", np.array([0.0, speed, 0.0]))
        engine.step(engine.whole_steps(1.2 * LOOK_S))
        out = np.linalg.norm(engine.pose("object_1").position[:2]) > RADIUS
        low, high = (low, speed) if out else (speed, high)
    return sqrt(low * high)
