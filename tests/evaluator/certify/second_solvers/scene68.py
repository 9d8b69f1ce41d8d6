"""First find the upward force on the ball at which basket and ball do not accelerate; it gives the counterweight.

The acceleration is linear in that force. Where it is 0, the counterweight's weight equals the weight of basket and ball
minus the force. With both masses known, the tension is that of Atwood's machine.
"""

from math import pi

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
BASKET, BALL = 0.3, 2.0
LOAD = BASKET + BALL
RADIUS = 0.1
FLOOR = 10.0
FORCES = (0.0, 2.0)
"""Upward forces on the ball [N]."""
SETTLE = 0.2
"""Time left to the ball after each change of the force [s]."""
RUN = 0.4
"""Time over which the acceleration is measured [s]."""


def solve(task: str) -> Protocol:
    """Measure the ball's acceleration under two forces, find the force that would balance, and from it the tension."""
    velocity = call("get_velocity", object_id="ball")
    density = BALL / (4 / 3 * pi * RADIUS**3)
    readings = yield [
        call(
            "create_objects", name="ball", pos=[0, 0, FLOOR + RADIUS], density=density, rgba=[1, 0, 0, 1], radius=RADIUS
        ),
        *(
            action
            for force in FORCES
            for action in (
                call("apply_force", object_id="ball", force_vector=[0, 0, force]),
                call("step", duration=SETTLE),
                velocity,
                call("step", duration=RUN),
                velocity,
            )
        ),
    ]
    speeds = [reading["velocity"][2] for reading in readings if "velocity" in reading]
    free, eased = ((speeds[i + 1] - speeds[i]) / RUN for i in (0, 2))
    balancing = FORCES[1] * free / (free - eased)
    counterweight = LOAD - balancing / GRAVITY
    yield [answer(2 * counterweight * LOAD * GRAVITY / (counterweight + LOAD))]
