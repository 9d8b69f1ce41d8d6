"""The platform's spin by its energy and its angular momentum: angular speed = 2 * energy / angular momentum.

Mass and shape drop out of the quotient, so each instant is measured by itself and no moments of inertia are compared.
"""

from scenes.protocol import Call, Protocol, Reading, answer, call

MASS = 1.0
"""Any mass will do [kg]."""
WAIT = 30.0
"""Time in which the weights come to stay [s]."""


def spin() -> list[Call]:
    """The two readings of the platform."""
    return [
        call("get_rotational_energy", object_id="object_1", mass=MASS),
        call("get_angular_momentum", object_id="object_1", mass=MASS),
    ]


def angular_speed(energy: Reading, momentum: Reading) -> float:
    """From I w²/2 and I w."""
    return 2 * energy["rotational_energy"] / momentum["angular_momentum"]["z"]


def solve(task: str) -> Protocol:
    """Measure the angular speed before any time has passed, and when the weights stay where they are."""
    start = yield spin()
    end = yield [call("step", duration=WAIT), *spin()]
    yield [answer(angular_speed(*end[1:]) / angular_speed(*start))]
