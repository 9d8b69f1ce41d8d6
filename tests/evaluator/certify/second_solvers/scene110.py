"""Measure the mass of object_1 by the impulse of the buffer at the start of the contact, and compute the deepest point
from the energy at the cut, without observing it.
"""

import math

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
STIFFNESS = 400.0
"""Of the buffer [N/m]."""
RUN = 0.60
"""Time on the rope [s]."""
TIME_STEP = 0.005
"""Of the simulation, and between two looks [s]."""
MARGIN = 0.02
"""Time after the arrival at the buffer before the first look [s]."""
LOOKS = 12
"""Looks at the beginning of the contact."""


def solve(task: str) -> Protocol:
    """m (gain of speed + g t) = k * (depth summed over time); then m v^2 / 2 + m g (height + depth) = k depth^2 / 2."""
    start = yield [
        call("get_position", object_id="object_1"),
        call("step", duration=RUN),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
        call("delete_objects", object_id="object_3"),
    ]
    level = start[0]["position"][2]
    height = start[2]["position"][2] - level
    speed = start[3]["velocity"][2]
    arrival = (speed + math.sqrt(speed**2 + 2 * GRAVITY * height)) / GRAVITY
    look = [
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
        call("step", duration=TIME_STEP),
    ]
    looks = yield [call("step", duration=arrival + MARGIN), *look * LOOKS]
    depths = [level - reading["position"][2] for reading in looks[1::3]]
    speeds = [reading["velocity"][2] for reading in looks[2::3]]
    depth_time = TIME_STEP * (sum(depths) - (depths[0] + depths[-1]) / 2)
    mass = STIFFNESS * depth_time / (speeds[-1] - speeds[0] + GRAVITY * TIME_STEP * (LOOKS - 1))
    sag = mass * GRAVITY / STIFFNESS
    energy = mass * (speed**2 / 2 + GRAVITY * height)
    yield [answer(sag + math.sqrt(sag**2 + 2 * energy / STIFFNESS))]
