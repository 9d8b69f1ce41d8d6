"""A ball in the pan is pressed down with two known forces; its own weight cancels.

The stiffness is the change of the force divided by the change of the pan's height at rest.
"""

from scenes.protocol import Protocol, answer, call

FLOOR = 1.0
"""Height of the upper side of the pan's floor at the start [m]."""
RADIUS = 0.1
"""Radius of the ball [m], which fits into the pan."""
PRESSURES = (5.0, 15.0)
"""Downward forces on the ball [N]."""
WAIT = 40.0
"""Time in which the pan comes to rest [s]."""


def solve(task: str) -> Protocol:
    """Press twice, and read where the pan comes to rest."""
    readings = yield [
        call("create_objects", name="ball", pos=[0, 0, FLOOR + RADIUS], density=200, rgba=[1, 0, 0, 1], radius=RADIUS),
        *(
            reading
            for pressure in PRESSURES
            for reading in (
                call("apply_force", object_id="ball", force_vector=[0, 0, -pressure]),
                call("step", duration=WAIT),
                call("get_position", object_id="object_1"),
            )
        ),
    ]
    high, low = (reading["position"][2] for reading in readings if "position" in reading and "orientation" in reading)
    yield [answer((PRESSURES[1] - PRESSURES[0]) / (high - low))]
