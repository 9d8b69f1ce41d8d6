"""Three heights equally far apart in time: their second difference is the acceleration, whatever the speed."""

from scenes.protocol import Protocol, answer, call

LAPSE = 0.4
"""Time between two readings of the height [s]."""


def solve(task: str) -> Protocol:
    """Time the run of object_1 by its heights, without a speed or an acceleration being read."""
    height = call("get_position", object_id="object_1")
    lapse = call("step", duration=LAPSE)
    readings = yield [lapse, height, lapse, height, lapse, height]
    first, second, third = (reading["position"][2] for reading in readings[1::2])
    yield [answer((third - 2 * second + first) / LAPSE**2)]
