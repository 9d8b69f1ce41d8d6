"""Scene 46: shift the rider until the beam just turns over, in ever smaller steps."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

ARM = 0.6
NEAR, FAR = 0.15, 1.1
ROUNDS = 8
HALF_TILTED_Z = 1.0 - 1.2 * np.sin(np.radians(2))
WATCH_S = 4.0
STIRRED_M = 0.002


def _rider_sinks(before, after):
    """Which way the tip went; if it stayed at a stop, at which."""
    if abs(after - before) > STIRRED_M:
        return after < before
    return after < HALF_TILTED_Z


def solve(task):
    """Halve the range of distances, in proportion, by the side that sinks."""
    found = yield [call("find_objects"), call("get_position", object_id="object_1")]
    rider, height = found[0]["revealed"][0], found[1]["position"][2]
    place, near, far = rider["position"][0], NEAR, FAR
    for _ in range(ROUNDS):
        wanted = sqrt(near * far)
        readings = yield [
            call("change_position", object_id=rider["object_id"], dx=wanted - place, dy=0, dz=0, in_world_frame=False),
            call("step", duration=WATCH_S),
            call("get_position", object_id="object_1"),
        ]
        place, before, height = wanted, height, readings[-1]["position"][2]
        if _rider_sinks(before, height):
            far = wanted
        else:
            near = wanted
    yield [answer(sqrt(near * far))]


def theory(knobs):
    """The rider's distance d1 m1 / m2."""
    return ARM * knobs["m1"] / knobs["m2"]


def measure(engine, knobs):
    """The same search in the engine, finer, from the fresh beam each time."""
    start, home = engine.save(), engine.pose("object_2").position
    near, far = NEAR, FAR
    for _ in range(14):
        wanted = sqrt(near * far)
        engine.restore(start)
        engine.place("object_2", home + np.array([wanted, 0.0, 0.0]), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        if engine.pose("object_1").position[2] < HALF_TILTED_Z:
            far = wanted
        else:
            near = wanted
    return sqrt(near * far)
