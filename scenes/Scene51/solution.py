"""Scene 51: throw the ball once, and read its energy and momentum during the flight."""

import numpy as np

from scenes.protocol import answer, call

MASS_KG = 2.0
THROW = 8.0
WAIT_S = 0.4


def solve(task):
    """Throw the ball, wait and read; the loss of momentum is the weight of the ball times the waiting time."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, THROW]),
        call("step", duration=WAIT_S),
        call("get_kinetic_energy", object_id="object_1", mass=MASS_KG),
        call("get_momentum", object_id="object_1", mass=MASS_KG),
    ]
    energy, momentum = readings[2]["kinetic_energy"], readings[3]["momentum"]["z"]
    gravity = (THROW - momentum / MASS_KG) / WAIT_S
    yield [answer([THROW**2 / (2 * gravity), energy], gravity=gravity)]


def theory(knobs):
    """H = v² / 2g and E = ½ m (v - g t)²."""
    return [THROW**2 / (2 * knobs["g"]), 0.5 * MASS_KG * (THROW - knobs["g"] * WAIT_S) ** 2]


def measure(engine, knobs):
    """The engine's throw, followed to the top in single steps."""
    start = engine.pose("object_1").position[2]
    engine.set_velocity("object_1", np.array([0.0, 0.0, THROW]))
    engine.step(engine.whole_steps(WAIT_S))
    speed = engine.twist("object_1").linear[2]
    height = engine.pose("object_1").position[2]
    while engine.twist("object_1").linear[2] > 0:
        engine.step(1)
        height = max(height, engine.pose("object_1").position[2])
    return [float(height - start), float(0.5 * MASS_KG * speed**2)]
