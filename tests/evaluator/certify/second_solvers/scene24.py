"""The direction of motion turns at the angular speed of the ball: radius = speed / angular speed."""

from itertools import pairwise
from math import atan2, hypot

from scenes.protocol import Protocol, answer, call

LAPSE = 0.05
"""Time in which the ball makes much less than half a turn [s]."""
LAPSES = 20


def solve(task: str) -> Protocol:
    """Read only the velocity of the found ball, and add up the angles by which its direction turns."""
    unseen = (yield [call("find_objects")])[0]["revealed"][0]["object_id"]
    velocity = call("get_velocity", object_id=unseen)
    readings = yield [velocity, *[call("step", duration=LAPSE), velocity] * LAPSES]
    seen = [reading["velocity"] for reading in readings[::2]]
    turned = sum(abs(atan2(ax * by - ay * bx, ax * bx + ay * by)) for (ax, ay, _), (bx, by, _) in pairwise(seen))
    speed = sum(hypot(vx, vy) for vx, vy, _ in seen) / len(seen)
    yield [answer(speed * LAPSE * LAPSES / turned)]
