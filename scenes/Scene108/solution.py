"""Scene 108: weld a ball to the rim, and let its speed tell that of the wheel."""

from math import hypot, pi

import numpy as np

from scenes.protocol import answer, call

TORQUE = 0.5
LASTS_S = 2.0
ARM = 0.4
RADIUS = 0.05
DENSITY = 1 / (4 / 3 * pi * RADIUS**3)
"""Of a ball of 1 kg."""


def solve(task):
    """The ball goes round with the wheel: ω = v / r."""
    readings = yield [
        call("create_objects", name="rider", pos=[ARM, 0, 1], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("attach_objects", object1_id="rider", object2_id="object_1", joint="weld"),
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, TORQUE]),
        call("get_torque", object_id="object_1"),
        call("step", duration=LASTS_S),
        call("get_velocity", object_id="rider"),
    ]
    vx, vy, _ = readings[-1]["velocity"]
    yield [answer(hypot(vx, vy) / ARM)]


def theory(knobs):
    """ω = τ t / (I + m r² + 2 m b² / 5)."""
    return TORQUE * LASTS_S / (knobs["inertia"] + ARM**2 + 0.4 * RADIUS**2)


def measure(engine, knobs):
    """The wheel's own angular speed in the engine."""
    engine.add_ball("rider", np.array([ARM, 0.0, 1.0]), DENSITY, RADIUS, np.ones(4), {})
    engine.join("rider", "object_1", "weld")
    engine.push("object_1", torque=[0.0, 0.0, TORQUE])
    engine.step(engine.whole_steps(LASTS_S))
    return float(engine.twist("object_1").angular[2])
