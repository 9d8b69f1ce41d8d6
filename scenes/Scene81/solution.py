"""Scene 81: raise the force on the trolley until the crate shifts or lifts, then close in on the force."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
HALF_WIDTH = 0.15
FIRST_N, RAISE = 205.0, 1.15
GLANCE_S, PUSH_S, BACK_S = 0.3, 0.5, 3.0
"""After a large step of the force a short push is enough, and the crate falls back instead of over."""
STIRRED_M = 0.004
LIFTS = 0.15
"""A crate that tips lifts its edge by three eighths of the way it goes back."""
ROUNDS = 5


def _push(force, duration):
    """Push for a moment, look, stop both, and let the crate fall back."""
    stop = [call("set_velocity", object_id=one, velocity_vector=[0, 0, 0]) for one in ("object_1", "object_2")]
    places = [call("get_position", object_id=one) for one in ("object_1", "object_2")]
    return [
        *places,
        call("apply_force", object_id="object_1", force_vector=[force, 0, 0]),
        call("step", duration=duration),
        *places,
        call("get_acceleration", object_id="object_1"),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        *stop,
        call("step", duration=BACK_S),
    ]


def _seen(readings):
    """How far the crate went back on the trolley, how far its edge rose, and the trolley's acceleration."""
    trolley, crate, trolley_after, crate_after = (np.array(readings[nth]["position"]) for nth in (0, 1, 4, 5))
    way = crate - trolley - crate_after + trolley_after
    return way[0], crate_after[2] - crate[2], readings[6]["x"]


def solve(task):
    """The greatest force that leaves the crate at rest and the least that does not enclose the limit."""
    force, back = FIRST_N, 0.0
    standing = None
    while True:
        back, rise, acceleration = _seen((yield _push(force, GLANCE_S)))
        if back > STIRRED_M:
            break
        standing = acceleration / force
        force *= RAISE
    low, high, lifts = force / RAISE, force, rise > LIFTS * back
    for _ in range(ROUNDS):
        force = sqrt(low * high)
        back, rise, acceleration = _seen((yield _push(force, PUSH_S)))
        if back > STIRRED_M:
            high, lifts = force, rise > LIFTS * back
        else:
            low, standing = force, acceleration / force
    yield [answer([2 if lifts else 1, sqrt(low * high) * standing])]


def theory(knobs):
    """It slides at μ g and tips at g b / h, whichever is less."""
    slides, tips = knobs["mu"] * GRAVITY, GRAVITY * HALF_WIDTH / knobs["height"]
    return [1.0 if slides < tips else 2.0, min(slides, tips)]


def measure(engine, knobs):
    """A finer search in the engine, from the same rest, around the true limit."""
    engine.step(engine.whole_steps(BACK_S))
    start, (which, wanted) = engine.save(), theory(knobs)
    low, high = 0.9 * wanted, 1.1 * wanted
    loaded = engine.mass("object_1") + engine.mass("object_2")
    crate, trolley = engine.pose("object_2").position.copy(), engine.pose("object_1").position.copy()
    for _ in range(7):
        acceleration = (low + high) / 2
        engine.restore(start)
        engine.push("object_1", force=[loaded * acceleration, 0.0, 0.0])
        engine.step(engine.whole_steps(PUSH_S))
        way = crate - trolley - engine.pose("object_2").position + engine.pose("object_1").position
        stirred = way[0] > STIRRED_M
        if stirred:
            which = 2.0 if -way[2] > LIFTS * way[0] else 1.0
        low, high = (low, acceleration) if stirred else (acceleration, high)
    return [which, float((low + high) / 2)]
