"""No period is timed: angular speed and angle at many times lie on an ellipse, which gives the frequency."""

import math

from scenes.protocol import Protocol, answer, call

BALL = "object_2"
HEIGHT = 1.0
ARM = 1.0
"""From the axis to the ball [m]."""
FORCE = 5.0
"""Push at the ball that starts the oscillation [N]."""
PUSH_TIME = 0.2
SLICE = 0.05
"""Time between two readings [s]."""
SLICES = 60


def solve(task: str) -> Protocol:
    """Without friction w^2 = c - omega^2 angle^2: a straight line in the squares, with slope -omega^2."""
    yield [
        call("move_object", object_id=BALL, x=ARM, y=0, z=HEIGHT),
        call("attach_objects", object1_id="object_1", object2_id=BALL),
        call("apply_force", object_id=BALL, force_vector=[0, FORCE, 0]),
        call("step", duration=PUSH_TIME),
        call("apply_force", object_id=BALL, force_vector=[0, 0, 0]),
    ]
    readings = (
        yield [
            call("step", duration=SLICE),
            call("get_position", object_id=BALL),
            call("get_velocity", object_id=BALL),
        ]
        * SLICES
    )
    angles = [math.atan2(r["position"][1], r["position"][0]) ** 2 for r in readings[1::3]]
    spins = [sum(part**2 for part in r["velocity"]) / ARM**2 for r in readings[2::3]]
    mean_angle, mean_spin = sum(angles) / SLICES, sum(spins) / SLICES
    slope = sum((a - mean_angle) * (s - mean_spin) for a, s in zip(angles, spins, strict=True)) / sum(
        (a - mean_angle) ** 2 for a in angles
    )
    yield [answer(2 * math.pi / math.sqrt(-slope))]
