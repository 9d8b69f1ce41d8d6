"""Scene 7: let the ball fall for 0.8 s and read its speed."""

import numpy as np

from scenes.protocol import answer, call

FALL_S = 0.8


def solve(task):
    """One fall, one reading."""
    readings = yield [call("step", duration=FALL_S), call("get_velocity", object_id="object_1")]
    yield [answer(abs(readings[-1]["velocity"][2]))]


def theory(knobs):
    """V = g t."""
    return knobs["g"] * FALL_S


def measure(engine, knobs):
    """The engine's own fall."""
    engine.step(engine.whole_steps(FALL_S))
    return float(np.linalg.norm(engine.twist("object_1").linear))
