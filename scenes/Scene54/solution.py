"""Scene 54: the force on one kilogram is the field; the throw follows from it."""

import numpy as np

from scenes.protocol import answer, call

THROW = (0.0, 4.0, 6.0)
LOOK_S = 0.1


def _landing(sideways, gravity):
    """Back at the height of the throw after 2 v / g."""
    time = 2 * THROW[2] / gravity
    return [sideways * time**2 / 2, THROW[1] * time]


def solve(task):
    """Let it fall for a moment; the field is the same everywhere and at any speed."""
    readings = yield [call("step", duration=LOOK_S), call("compute_force", object_id="object_1", mass=1.0)]
    yield [answer(_landing(readings[-1]["x"], -readings[-1]["z"]))]


def theory(knobs):
    """x = a t² / 2 and y = 4 t, with t = 12 / g."""
    return _landing(knobs["way"] * knobs["a"], knobs["g"])


def measure(engine, knobs):
    """The engine's throw, followed in single steps until it is back, and taken back to the height within the last."""
    start = engine.pose("object_1").position
    engine.set_velocity("object_1", np.array(THROW))
    engine.step(1)
    before, after = start, engine.pose("object_1").position
    while after[2] > start[2]:
        engine.step(1)
        before, after = after, engine.pose("object_1").position
    share = (before[2] - start[2]) / (before[2] - after[2])
    landing = before + share * (after - before) - start
    return [float(landing[0]), float(landing[1])]
