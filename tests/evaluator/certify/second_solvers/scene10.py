"""Finds the acceleration as the second difference of three heights at equal time intervals, at any speed."""

from scenes.protocol import Protocol, answer, call

LAPSE = 0.4
"""Time between two readings of the height [s]."""


def solve(task: str) -> Protocol:
    """Read heights of object_1 only, no velocity and no acceleration."""
    height = call("get_position", object_id="object_1")
    lapse = call("step", duration=LAPSE)
    readings = yield [lapse, height, lapse, height, lapse, height]
    first, second, third = (reading["position"][2] for reading in readings[1::2])
    yield [answer((third - 2 * second + first) / LAPSE**2)]
