"""Null method: find the velocity of a ball at which it has no acceleration; this is the velocity of the stream."""

import math

from scenes.protocol import Call, Protocol, answer, call

BALL = "probe"
RADIUS = 0.1
DENSITY = 100.0
TIME_STEP = 0.005
FIRST = 0.5
"""First change of both horizontal components of the velocity [m/s]."""
STILL = 3e-3
"""Acceleration [m/s²] that counts as none: the velocities are read to 1e-5 m/s."""
TRIALS = 16


def trial(velocity: list[float]) -> list[Call]:
    """Set the ball's velocity and read its acceleration after one time step."""
    return [
        call("set_velocity", object_id=BALL, velocity_vector=[*velocity, 0]),
        call("step", duration=TIME_STEP),
        call("get_acceleration", object_id=BALL),
    ]


def solve(task: str) -> Protocol:
    """Secant method on acceleration against velocity, for each horizontal component."""
    yield [call("create_objects", name=BALL, pos=[0, 0, 1], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS)]
    velocity, steps, pull = [0.0, 0.0], [FIRST, FIRST], [math.nan, math.nan]
    for _ in range(TRIALS):
        *_, acceleration = yield trial(velocity)
        before, pull = pull, [acceleration["x"], acceleration["y"]]
        if math.hypot(*pull) < STILL:
            break
        for axis in range(2):
            change = pull[axis] - before[axis]
            if not math.isnan(change):
                steps[axis] = -pull[axis] * steps[axis] / change if change else 0.0
            velocity[axis] += steps[axis]
    yield [answer(math.hypot(*velocity))]
