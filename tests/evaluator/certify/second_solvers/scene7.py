"""Mean-value method: in uniform gravity the speed at an instant is the mean speed over a time centred on it."""

from scenes.protocol import Protocol, answer, call

ASKED = 0.8
"""Instant the speed is asked for [s]."""
HALF = 0.2
"""Half of the time over which the mean is taken [s]."""


def solve(task: str) -> Protocol:
    """Measure heights alone, and divide the fall between 0.6 s and 1.0 s by the time it took."""
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
