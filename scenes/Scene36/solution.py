"""Scene 36: push the trolley harder or less hard until the load is just carried along."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GENTLE_N = 5.0
"""Even the lightest load on the smoothest bed stays where it is."""
LOW, HIGH = 0.8, 7.5
"""Accelerations [m/s²] between which the limit lies."""
PROBES = 9
WATCH_S = 1.0
SETTLE_S = 2.0
SHIFTED_M = 1e-3


def _push(force):
    """Push from rest on the bed, look where both are and how fast the trolley gains speed, then let it settle."""
    return [
        call("get_position", object_id="object_1"),
        call("get_position", object_id="object_2"),
        call("apply_force", object_id="object_1", force_vector=[force, 0, 0]),
        call("step", duration=WATCH_S),
        call("get_position", object_id="object_1"),
        call("get_position", object_id="object_2"),
        call("compute_force", object_id="object_1", mass=1.0),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        call("step", duration=SETTLE_S),
    ]


def _shift(readings):
    """How far the load has slid over the bed."""
    before, after = (readings[k + 1]["position"][0] - readings[k]["position"][0] for k in (0, 4))
    return abs(after - before)


def solve(task):
    """Weigh trolley and load together with a gentle push, then halve the range of accelerations."""
    readings = yield _push(GENTLE_N)
    whole = GENTLE_N / readings[6]["x"]
    low, high = LOW, HIGH
    direction = 1.0
    for _ in range(PROBES):
        tried = sqrt(low * high)
        direction = -direction
        readings = yield _push(direction * whole * tried)
        low, high = (low, tried) if _shift(readings) > SHIFTED_M else (tried, high)
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """Friction gives the load at most μ m g, hence a = μ g."""
    return 9.81 * knobs["mu"]


def measure(engine, knobs):
    """The engine's own limit: the load is watched for longer, and the masses are known."""
    start = engine.save()
    whole = knobs["trolley"] + knobs["load"]
    low, high = LOW, HIGH
    for _ in range(16):
        tried = sqrt(low * high)
        engine.restore(start)
        engine.push("object_1", force=np.array([whole * tried, 0.0, 0.0]))
        engine.step(engine.whole_steps(2 * WATCH_S))
        shift = engine.pose("object_1").position[0] - engine.pose("object_2").position[0]
        low, high = (low, tried) if abs(shift) > SHIFTED_M else (tried, high)
    return sqrt(low * high)
