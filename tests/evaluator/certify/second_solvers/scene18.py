"""A known force presses a ball of known mass against the glider: the glider gets the rest of the impulse.

Force times time equals the gain of momentum of ball and glider together, even if the ball bounces in between.
"""

from math import pi

from scenes.protocol import Protocol, answer, call

RADIUS = 0.1
DENSITY = 500.0
BALL_MASS = DENSITY * 4 / 3 * pi * RADIUS**3
FORCE = 4.0
TIME = 3.0
HALF_EDGE = 0.1


def solve(task: str) -> Protocol:
    """Push the ball from rest, touching the glider, and balance the momenta."""
    readings = yield [
        call(
            "create_objects",
            name="ball",
            pos=[-HALF_EDGE - RADIUS, 0, 1],
            density=DENSITY,
            rgba=[1, 0, 0, 1],
            radius=RADIUS,
        ),
        call("apply_force", object_id="ball", force_vector=[FORCE, 0, 0]),
        call("step", duration=TIME),
        call("get_velocity", object_id="ball"),
        call("get_velocity", object_id="object_1"),
    ]
    ball, glider = readings[3]["velocity"][0], readings[4]["velocity"][0]
    yield [answer((FORCE * TIME - BALL_MASS * ball) / glider)]
