"""In uniform gravity the speed at an instant equals the mean speed over an interval centred on it."""

from scenes.protocol import Protocol, answer, call

ASKED = 0.8
"""Time at which the question asks for the speed [s]."""
HALF = 0.2
"""Half of the time over which the mean is taken [s]."""


def solve(task: str) -> Protocol:
    """Read only heights, and divide the fall between 0.6 s and 1.0 s by the time."""
    height = call("get_position", object_id="object_1")
    readings = yield [
        call("step", duration=ASKED - HALF),
        height,
        call("step", duration=2 * HALF),
        height,
    ]
    before, after = readings[1], readings[3]
    fall = before["position"][2] - after["position"][2]
    yield [answer(fall / (after["sim_time"] - before["sim_time"]))]
