"""Computes the effect of the push that the task asks about from both friction coefficients, without applying that push.

The blocks are set in motion in opposite directions to measure the coefficients.
"""

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
LONG, SMALL = 3.0, 1.0
"""Masses [kg]."""
PUSH = 20.0
"""Force of the push that the task asks about [N]."""
SPEED = 2.0
"""Speed of the blocks, one forward, one backward [m/s]."""
WINDOW = 0.1
"""Time in which neither block stops or reaches an end [s]."""


def solve(task: str) -> Protocol:
    """A friction coefficient is the impulse of the friction divided by the impulse of the normal force.

    The measured impulse of the normal force includes the vertical motion of a block that hops.

    Only the upper friction brakes the small block; both brake the long one.
    """
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("set_velocity", object_id="object_2", velocity_vector=[-SPEED, 0, 0]),
        call("step", duration=WINDOW),
        call("get_velocity", object_id="object_1"),
        call("get_velocity", object_id="object_2"),
    ]
    (long_x, _, long_z), (small_x, _, small_z) = (reading["velocity"] for reading in readings[3:])
    upper_impulse = SMALL * (small_x + SPEED)
    lower_impulse = LONG * (SPEED - long_x) - upper_impulse
    upper_normal = SMALL * (GRAVITY * WINDOW + small_z)
    lower_normal = upper_normal + LONG * (GRAVITY * WINDOW + long_z)
    upper, lower = upper_impulse / upper_normal, lower_impulse / lower_normal
    together = PUSH / (LONG + SMALL) - lower * GRAVITY
    if together <= 0:
        yield [answer("neither block moves")]
    elif together <= upper * GRAVITY:
        yield [answer("both blocks move together")]
    else:
        yield [answer("the small block lags behind")]
