"""Scene 29: find from both sides how far the bar must be shifted before the cradle tips over."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

TILT = radians(4)
EDGE_Z = 1.0
FAR_LEFT, FAR_RIGHT = -1.18, -0.02
"""Places of the marked end [m] at which the bar surely tips the cradle to the left or to the right."""
ROUNDS = 10
TIP_S, LOOK_S = 1.5, 2.0


def _at(place, side):
    """Where the marked end is, at a place along a cradle that the bar has tipped from a side."""
    tilt = TILT if side == FAR_RIGHT else -TILT
    return [place * cos(tilt), 0.0, EDGE_Z - place * sin(tilt)]


def _put(x, y, z):
    return call("move_object", object_id="object_1", x=x, y=y, z=z)


def _trial(side, place):
    """Tip the cradle to one side, put the bar to a place, and look which side is down."""
    return [
        _put(side, 0, EDGE_Z),
        call("step", duration=TIP_S),
        _put(*_at(place, side)),
        call("step", duration=LOOK_S),
        call("get_position", object_id="object_1"),
    ]


def _left_is_down(reading, place):
    """The marked end, left of the edge, goes down with the left side."""
    return (reading["position"][2] < EDGE_Z) == (place < 0)


def solve(task):
    """Halve two ranges at once: where the tipped-right cradle goes over to the left, and the reverse."""
    to_left, to_right = [FAR_LEFT, FAR_RIGHT], [FAR_LEFT, FAR_RIGHT]
    for _ in range(ROUNDS):
        first, second = sum(to_left) / 2, sum(to_right) / 2
        readings = yield [*_trial(FAR_RIGHT, first), *_trial(FAR_LEFT, second)]
        to_left[0 if _left_is_down(readings[4], first) else 1] = first
        to_right[0 if _left_is_down(readings[9], second) else 1] = second
    yield [answer(-(sum(to_left) + sum(to_right)) / 4)]


def theory(knobs):
    """The distance that was drawn."""
    return knobs["c"]


def _limit(engine, side):
    """The place of the marked end at which the cradle tips over from one side, from a fresh state each time."""
    start = engine.save()
    low, high = FAR_LEFT, FAR_RIGHT
    for _ in range(14):
        place = (low + high) / 2
        engine.restore(start)
        for target, seconds in (([side, 0.0, EDGE_Z], TIP_S), (_at(place, side), LOOK_S)):
            engine.place("object_1", np.array(target), {})
            engine.step(engine.whole_steps(seconds))
        if (engine.pose("object_1").position[2] < EDGE_Z) == (place < 0):
            low = place
        else:
            high = place
    engine.restore(start)
    return (low + high) / 2


def measure(engine, knobs):
    """Half-way between the engine's two limits."""
    return -(_limit(engine, FAR_LEFT) + _limit(engine, FAR_RIGHT)) / 2
