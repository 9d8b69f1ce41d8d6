"""Nothing is caught: measure the mass of the puck by a push, and that of the pair by how far a constant force swings it
out; then compute the height from momentum and energy.
"""

import math

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
ROD = 2.0
"""From the pivot to the centre of the bob [m]."""
BOB = [3.0, 0.0, 0.5]
"""Centre of the resting bob [m]."""
SPEED = 5.0
"""Speed [m/s] at which the puck is to meet the bob."""
FORCE = 4.0
"""Steady force along x [N]."""
PUSH_TIME = 0.5
"""How long the puck alone is pushed [s]."""
READ_EVERY = 0.02
"""Time between two readings of the swing [s]."""
READINGS = 150
"""Readings of the swing: 3 s, more than a period of a 2 m pendulum."""


def solve(task: str) -> Protocol:
    """Under a constant force the pair turns back where F L sin = M g L (1 - cos), that is tan(angle / 2) = F / M g.

    If the bob catches the puck at speed v, the pair starts with u = v m / M and rises u^2 / 2 g.
    """
    weighing = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE, 0, 0]),
        call("step", duration=PUSH_TIME),
        call("get_velocity", object_id="object_1"),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("move_object", object_id="object_1", x=BOB[0], y=BOB[1], z=BOB[2]),
        call("attach_objects", object1_id="object_1", object2_id="object_2", joint="hinge", axis=[0, 1, 0]),
    ]
    puck = FORCE * PUSH_TIME / weighing[2]["velocity"][0]
    swing = (
        yield [
            call("step", duration=READ_EVERY),
            call("get_position", object_id="object_1"),
        ]
        * READINGS
    )
    reach = max(reading["position"][0] for reading in swing[1::2]) - BOB[0]
    pair = FORCE / (GRAVITY * math.tan(math.asin(reach / ROD) / 2))
    shared = SPEED * puck / pair
    yield [answer(shared**2 / (2 * GRAVITY))]
