"""Scene 23: find the pad, press it, and divide the force by the way it gives."""

import numpy as np

from scenes.protocol import answer, call

FORCE_N = 20.0
REST_S = 12.0


def _height(pad):
    """The potential energy of one newton of weight is its height."""
    return call("get_potential_energy", object_id=pad, mass=1.0, gravity=1.0)


def solve(task):
    """Two heights of the pad: at rest, and at rest again under a known force."""
    found = yield [call("find_objects")]
    pad = found[0]["revealed"][0]["object_id"]
    readings = yield [
        _height(pad),
        call("apply_force", object_id=pad, force_vector=[0, 0, -FORCE_N]),
        call("step", duration=REST_S),
        _height(pad),
    ]
    yield [answer(FORCE_N / (readings[0]["potential_energy"] - readings[-1]["potential_energy"]))]


def theory(knobs):
    """The stiffness that was drawn."""
    return knobs["k"]


def measure(engine, knobs):
    """Pulled up instead, with half the force."""
    start = engine.pose("object_2").position[2]
    engine.push("object_2", force=np.array([0.0, 0.0, FORCE_N / 2]))
    engine.step(engine.whole_steps(REST_S))
    return float(FORCE_N / 2 / (engine.pose("object_2").position[2] - start))
