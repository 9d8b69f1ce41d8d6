"""Null method: the upward force on the hidden object at which the spring does not bend equals its weight.

The beam rests where k * angle = (W - F) x cos(angle), so angle / cos(angle) is linear in the force F. Two forces give
the force at which it is 0; the stiffness k and the position x are not needed.
"""

from math import atan2, cos

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
AXIS_HEIGHT = 1.0
PLACE = 0.5
FORCES = (0.0, 2.0)
"""Upward forces on the found object [N]."""
WAIT = 60.0
"""Time in which the beam comes to rest [s]."""


def solve(task: str) -> Protocol:
    """Put the found object on one half of the beam, and read the tilt of the beam at rest under two forces."""
    found = (yield [call("find_objects")])[0]["revealed"][0]
    unseen = found["object_id"]
    readings = yield [
        call("move_object", object_id=unseen, x=PLACE, y=found["position"][1], z=found["position"][2]),
        *(
            action
            for force in FORCES
            for action in (
                call("apply_force", object_id=unseen, force_vector=[0, 0, force]),
                call("step", duration=WAIT),
                call("get_position", object_id="object_1"),
            )
        ),
    ]
    tips = [reading["position"] for reading in readings if "orientation" in reading]
    angles = [atan2(AXIS_HEIGHT - z, x) for x, _, z in tips]
    free, eased = (angle / cos(angle) for angle in angles)
    yield [answer(FORCES[1] * free / (free - eased) / GRAVITY)]
