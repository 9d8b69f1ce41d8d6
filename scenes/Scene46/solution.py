"""Scene 46: shift the rider until the side that sinks changes, in ever smaller steps."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

NEAR, FAR = 0.15, 1.15
ROUNDS = 9
LEVEL_Z = 1.0
WATCH_S = 3.0
STIRRED_M = 0.002


def _rider_sinks(before, after):
    """Which way the tip moved; if it stayed at a stop, at which."""
    if abs(after - before) > STIRRED_M:
        return after < before
    return after < LEVEL_Z


def solve(task):
    """Halve the range of distances, in proportion, by the side that sinks."""
    found = yield [call("find_objects"), call("get_position", object_id="object_1")]
    rider = found[0]["revealed"][0]
    place, tip = rider["position"][0], found[1]["position"][2]
    near, far = NEAR, FAR
    for _ in range(ROUNDS):
        wanted = sqrt(near * far)
        readings = yield [
            call("change_position", object_id=rider["object_id"], dx=wanted - place, dy=0, dz=0, in_world_frame=False),
            call("get_position", object_id="object_1"),
            call("step", duration=WATCH_S),
            call("get_position", object_id="object_1"),
        ]
        place, before = wanted, readings[1]["position"][2]
        tip = readings[3]["position"][2]
        if _rider_sinks(before, tip):
            far = wanted
        else:
            near = wanted
    yield [answer(sqrt(near * far))]


def theory(knobs):
    """X = m1 d1 / m2."""
    return knobs["m1"] * 0.4 / knobs["m2"]


def measure(engine, knobs):
    """The same search in the engine, from a fresh level beam each time."""
    start, home = engine.save(), 0.5
    near, far = NEAR, FAR
    for _ in range(14):
        wanted = sqrt(near * far)
        engine.restore(start)
        engine.place("object_2", engine.pose("object_2").position + np.array([wanted - home, 0.0, 0.0]), {})
        before = engine.pose("object_1").position[2]
        engine.step(engine.whole_steps(WATCH_S))
        if engine.pose("object_1").position[2] < before:
            far = wanted
        else:
            near = wanted
    return sqrt(near * far)
