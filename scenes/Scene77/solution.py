"""Scene 77: set the puck in at one distance after another, and halve the range by whether it slides outward."""

from math import hypot

import numpy as np

from scenes.protocol import answer, call

FIRST_M = 0.1
NEAR, FAR = 0.3, 4.0
ROUNDS = 11
WATCH_S = 2.0
SLIPS_M = 0.001


def _shift(x, y, distance):
    """Calls that move the puck from (x, y) along the groove to a distance from the axis, and let it rest there."""
    factor = distance / hypot(x, y) - 1
    return [
        call("change_position", object_id="object_2", dx=factor * x, dy=factor * y, dz=0),
        call("set_velocity", object_id="object_2", velocity_vector=[0, 0, 0]),
        call("get_displacement", object_id="object_2"),
        call("step", duration=WATCH_S),
        call("get_displacement", object_id="object_2"),
        call("get_position", object_id="object_2"),
    ]


def solve(task):
    """The puck began on the axis, so that its displacement is its distance from the axis."""
    readings = yield [
        call("change_position", object_id="object_2", dx=FIRST_M, dy=0, dz=0),
        call("get_position", object_id="object_2"),
    ]
    low, high = NEAR, FAR
    for _ in range(ROUNDS):
        x, y, _ = readings[-1]["position"]
        middle = (low + high) / 2
        readings = yield _shift(x, y, middle)
        slips = readings[4]["displacement"] - readings[2]["displacement"] > SLIPS_M
        low, high = (low, middle) if slips else (middle, high)
    yield [answer((low + high) / 2)]


def theory(knobs):
    """Balance at the limit: m ω² r = f + k (r - L), for 1 kg."""
    return (knobs["f"] - knobs["k"] * knobs["length"]) / (knobs["omega"] ** 2 - knobs["k"])


def measure(engine, knobs):
    """A finer search in the engine, with a longer look."""
    start = engine.save()
    low, high = NEAR, FAR
    for _ in range(14):
        middle = (low + high) / 2
        engine.restore(start)
        engine.place("object_2", engine.pose("object_2").position + np.array([middle, 0.0, 0.0]), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        place = engine.pose("object_2").position
        low, high = (low, middle) if hypot(place[0], place[1]) - middle > SLIPS_M else (middle, high)
    return (low + high) / 2
