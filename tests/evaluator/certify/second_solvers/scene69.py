"""Pull the ball in its cup, which turns the turntable; its inertia follows from the work of the force.

The ball need not be at rest in the cup when the force starts, because its speed is read.
"""

import math

from scenes.protocol import Call, Protocol, answer, call

TABLE, BALL = "object_1", "ball"
CUP = [0.5, 0.0, 1.1]
"""Where a ball of radius RADIUS rests in the cup at the start [m]."""
RADIUS = 0.10
MASS = 0.2
"""Mass of the ball [kg]."""
DENSITY = MASS / (4 / 3 * math.pi * RADIUS**3)
FORCE = [0.0, 3.0, 0.0]
"""Force on the ball, at first along the motion of the cup [N]."""
SETTLE = 0.2
"""Time for the ball to come to rest in the cup [s]."""
PULL_TIME = 0.4


def look() -> list[Call]:
    """Read the motion of the ball, and the energy and angular momentum that the turntable would have with 1 kg."""
    return [
        call("get_position", object_id=BALL),
        call("get_velocity", object_id=BALL),
        call("get_rotational_energy", object_id=TABLE, mass=1),
        call("get_angular_momentum", object_id=TABLE, mass=1),
    ]


def solve(task: str) -> Protocol:
    """(I w^2 + m v^2) / 2 grows by the work of the force; the turntable's w is 2 * energy / angular momentum."""
    readings = yield [
        call("create_objects", name=BALL, pos=CUP, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=SETTLE),
        *look(),
        call("apply_force", object_id=BALL, force_vector=FORCE),
        call("step", duration=PULL_TIME),
        *look(),
    ]
    ends: list[tuple[list[float], float, float]] = []
    for place, velocity, energy, momentum in (readings[2:6], readings[8:12]):
        spin = 2 * energy["rotational_energy"] / momentum["angular_momentum"]["z"]
        ends.append((place["position"], sum(part**2 for part in velocity["velocity"]), spin**2))
    (start, slow, spin_slow), (end, fast, spin_fast) = ends
    work = sum(force * (b - a) for force, a, b in zip(FORCE, start, end, strict=True))
    yield [answer((2 * work - MASS * (fast - slow)) / (spin_fast - spin_slow))]
