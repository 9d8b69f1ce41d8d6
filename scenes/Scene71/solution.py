"""Scene 71: move the hidden rider along the beam, and compute its mass from the torque of the spring."""

from math import asin

import numpy as np

from scenes.protocol import answer, call

KAPPA = 60.0
GRAVITY = 9.81
SHIFT = 0.5
LEVER = 1.0
AXIS_Z = 1.0


def solve(task):
    """Find the rider, shift it outward, and compute its mass from the torque of the spring at rest."""
    found = yield [call("find_objects")]
    rider = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("change_position", object_id=rider, dx=SHIFT, dy=0, dz=0),
        call("step", duration=15),
        call("get_position", object_id="object_1"),
        call("get_position", object_id=rider),
    ]
    turned = yield [call("quat_to_rot_matrix", q=readings[2]["orientation"])]
    # The first column is the direction of the beam.
    angle = asin(-turned[0]["rotation_matrix"][2][0])
    yield [answer(KAPPA * angle / (GRAVITY * readings[3]["position"][0]))]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The same balance in the engine, from the height of the tip, for a smaller shift and a longer rest."""
    engine.place("object_2", engine.pose("object_2").position + np.array([0.1, 0.0, 0.0]), {})
    engine.step(engine.whole_steps(40.0))
    tip, rider = engine.pose("object_1").position, engine.pose("object_2").position
    angle = asin((AXIS_Z - tip[2]) / LEVER)
    return float(KAPPA * angle / (GRAVITY * rider[0]))
