"""Work and energy: a known force times the measured distance equals the kinetic energy of the hidden object."""

from math import dist, hypot

from scenes.protocol import Protocol, answer, call

FORCE = (0.0, 0.6, 0.8)
"""Force on the object, away from the post [N]."""
SIZE_OF_FORCE = hypot(*FORCE)
LAPSE = 2.0
"""[s]."""


def solve(task: str) -> Protocol:
    """Find the object, push it from rest, and divide the work of the force by half the square of the speed."""
    found = (yield [call("find_objects")])[0]["revealed"][0]
    unseen, start = found["object_id"], found["position"]
    readings = yield [
        call("apply_force", object_id=unseen, force_vector=list(FORCE)),
        call("step", duration=LAPSE),
        call("get_position", object_id=unseen),
        call("get_velocity", object_id=unseen),
    ]
    work = SIZE_OF_FORCE * dist(start, readings[2]["position"])
    yield [answer(work / (hypot(*readings[3]["velocity"]) ** 2 / 2))]
