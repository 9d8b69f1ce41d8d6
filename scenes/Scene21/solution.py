"""Scene 21: find the ball, push it, and divide force by acceleration."""

import numpy as np

from scenes.protocol import answer, call

FORCE_N = 6.0


def solve(task):
    """Find the hidden ball, push it with a known force, and compute its mass from the acceleration."""
    found = yield [call("find_objects")]
    ball = found[0]["revealed"][0]["object_id"]
    pushed = yield [
        call("apply_force", object_id=ball, force_vector=[FORCE_N, 0, 0]),
        call("step", duration=0.1),
        call("compute_force", object_id=ball, mass=1.0),
    ]
    yield [answer(FORCE_N / pushed[-1]["x"])]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """Force over the engine's acceleration."""
    engine.push("object_2", force=np.array([FORCE_N, 0.0, 0.0]))
    engine.step(20)
    return FORCE_N / float(engine.acceleration("object_2")[0])
