"""Scene 22: find the puck, strike it, and read how fast it leaves."""

import numpy as np

from scenes.protocol import answer, call

SPEED = 3.0
MASS_KG = 1.0
RUN_S = 1.5
ELSEWHERE = -0.137


def solve(task):
    """Its momentum for a mass of one is its speed."""
    found = yield [call("find_objects")]
    puck = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=RUN_S),
        call("get_momentum", object_id=puck, mass=1.0),
    ]
    yield [answer(readings[-1]["momentum"]["x"])]


def measure(engine, knobs):
    """The same collision from another start, from what the striking puck loses: m (v - v') / M."""
    engine.place("object_1", np.array([ELSEWHERE, 0.0, 0.5]), {})
    engine.set_velocity("object_1", np.array([SPEED, 0.0, 0.0]))
    engine.step(engine.whole_steps(RUN_S))
    lost = SPEED - float(engine.twist("object_1").linear[0])
    return MASS_KG * lost / knobs["m"]
