"""Scene 48: set the slider down ever nearer to the place where it just stays."""

from math import cos, pi, sin, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
REACH = 5.1
"""Distance of the touching slider's middle from the centre of the dome."""
NEAR, FAR = 0.2, 4.2
ROUNDS = 10
WATCH_S = 2.0
STIRRED_M = 0.004


def _place(x):
    return [x, 0.0, sqrt(REACH**2 - x**2)]


def solve(task):
    """Halve the range of distances, in proportion, by whether the slider moves off."""
    found = yield [call("find_objects")]
    slider = found[0]["revealed"][0]["object_id"]
    near, far = NEAR, FAR
    for _ in range(ROUNDS):
        x, y, z = _place(sqrt(near * far))
        readings = yield [
            call("move_object", object_id=slider, x=x, y=y, z=z),
            call("set_velocity", object_id=slider, velocity_vector=[0, 0, 0]),
            call("get_displacement", object_id=slider),
            call("step", duration=WATCH_S),
            call("get_displacement", object_id=slider),
        ]
        stirred = readings[-1]["displacement"] - readings[2]["displacement"] > STIRRED_M
        near, far = (near, x) if stirred else (x, far)
    yield [answer(sqrt(near * far))]


def _excess(knobs, angle):
    """Force per mass along the dome, beyond what friction can hold, at an angle from the top [m/s²]."""
    depth = knobs["depth"]
    distance = sqrt((REACH * sin(angle)) ** 2 + (REACH * cos(angle) - depth) ** 2)
    pull = knobs["k"] / knobs["m"] * (distance - knobs["free"]) / distance
    along = (GRAVITY - pull * depth) * sin(angle)
    onto = GRAVITY * cos(angle) + pull * (REACH - depth * cos(angle))
    return along - knobs["mu"] * onto


def theory(knobs):
    """The distance at which the force along the dome is what friction can hold."""
    low, high = 0.0, pi / 3
    for _ in range(50):
        angle = (low + high) / 2
        low, high = (low, angle) if _excess(knobs, angle) > 0 else (angle, high)
    return REACH * sin(low)


def measure(engine, knobs):
    """The same search in the engine, from the fresh state each time, around the true place."""
    start, wanted = engine.save(), theory(knobs)
    near, far = 0.9 * wanted, 1.1 * wanted
    for _ in range(7):
        x = (near + far) / 2
        engine.restore(start)
        engine.place("object_2", np.array(_place(x)), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        stirred = engine.pose("object_2").position[0] - x > STIRRED_M
        near, far = (near, x) if stirred else (x, far)
    return (near + far) / 2
