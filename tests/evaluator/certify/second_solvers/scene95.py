"""Scene 95, another way: a single run; the ball is deleted in motion, and the block coasts.

With M = block + basket + I/R² and friction f: (M + m) a = (basket + m) g - f, and without the ball M a' = basket g - f.
The two accelerations give M and f; the tension is (basket + m)(g - a).
"""

from math import pi

from scenes.protocol import Call, Protocol, Reading, answer, call

GRAVITY = 9.81
BLOCK, BASKET = 5.0, 0.1
BALL, RADIUS = 3.0, 0.1
FLOOR = (0.0, 0.0, 38.0)
SETTLING, PULLING, COASTING = 0.5, 2.0, 0.2


def look(duration: float) -> list[Call]:
    """Step and read the basket's velocity."""
    return [call("step", duration=duration), call("get_velocity", object_id="object_2")]


def acceleration(first: Reading, second: Reading) -> float:
    """Mean downward acceleration between two readings."""
    return (first["velocity"][2] - second["velocity"][2]) / (second["sim_time"] - first["sim_time"])


def solve(task: str) -> Protocol:
    """Pull with the ball, delete it, and compare the two accelerations."""
    x, y, z = FLOOR
    density = BALL / (4 / 3 * pi * RADIUS**3)
    readings = yield [
        call("create_objects", name="ball", pos=[x, y, z + RADIUS], density=density, rgba=[1, 0, 0, 1], radius=RADIUS),
        *look(SETTLING),
        *look(PULLING),
        call("delete_objects", object_id="ball"),
        *look(0.005),
        *look(COASTING),
    ]
    pulled = acceleration(readings[2], readings[4])
    coasting = acceleration(readings[7], readings[9])
    moving = ((BASKET + BALL) * GRAVITY - BALL * pulled - BASKET * GRAVITY) / (pulled - coasting)
    friction = BASKET * GRAVITY - moving * coasting
    yield [answer([friction / (BLOCK * GRAVITY), (BASKET + BALL) * (GRAVITY - pulled)])]
