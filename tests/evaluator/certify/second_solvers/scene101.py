"""Attach the second block to the moving first one: conservation of momentum gives the ratio of the masses.

One push on the first block alone gives its mass; the pair is never pushed.
"""

from scenes.protocol import Protocol, answer, call

FORCE = 12.0
"""Push [N] in the task; the same push measures the mass of object_1."""
PUSH_TIME = 0.5
"""How long object_1 alone is pushed [s]."""
SPEED = 0.4
"""Speed [m/s] of object_1 when it is exactly 0.60 m away from object_2."""
RUN_UP = 0.2
"""Distance [m] that object_1 moves before that position: half a second at SPEED."""
COAST = 1.0
"""Time [s] over which the speed of the pair is averaged."""


def solve(task: str) -> Protocol:
    """m1 = F t / v; m2 / m1 = u / u' - 1; then a = F / (m1 + m2) and object_2 is pushed with m2 a."""
    first = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE, 0, 0]),
        call("step", duration=PUSH_TIME),
        call("get_velocity", object_id="object_1"),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        call("move_object", object_id="object_1", x=-RUN_UP, y=0, z=1),
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=RUN_UP / SPEED),
        call("get_position", object_id="object_1"),
        call("attach_objects", object1_id="object_1", object2_id="object_2"),
        call("step", duration=COAST),
        call("get_position", object_id="object_1"),
        call("step", duration=COAST),
        call("get_position", object_id="object_1"),
    ]
    mass_1 = FORCE * PUSH_TIME / first[2]["velocity"][0]
    shared = (first[12]["position"][0] - first[10]["position"][0]) / COAST
    mass_2 = mass_1 * (SPEED / shared - 1)
    acceleration = FORCE / (mass_1 + mass_2)
    yield [answer([acceleration, mass_2 * acceleration])]
