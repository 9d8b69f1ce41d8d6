"""The platform's angular speed from energy and angular momentum: angular speed = 2 * energy / angular momentum.

Mass and shape cancel in the quotient, so no moments of inertia are needed.
"""

from scenes.protocol import Call, Protocol, Reading, answer, call

MASS = 1.0
"""Assumed mass [kg]. The result does not depend on it."""
WAIT = 30.0
"""Time after which the weights no longer move [s]."""


def spin() -> list[Call]:
    """Return the calls that read the energy and the angular momentum of the platform."""
    return [
        call("get_rotational_energy", object_id="object_1", mass=MASS),
        call("get_angular_momentum", object_id="object_1", mass=MASS),
    ]


def angular_speed(energy: Reading, momentum: Reading) -> float:
    """Compute the angular speed w from the energy I w²/2 and the angular momentum I w."""
    return 2 * energy["rotational_energy"] / momentum["angular_momentum"]["z"]


def solve(task: str) -> Protocol:
    """Measure the angular speed at the start, and when the weights no longer move."""
    start = yield spin()
    end = yield [call("step", duration=WAIT), *spin()]
    yield [answer(angular_speed(*end[1:]) / angular_speed(*start))]
