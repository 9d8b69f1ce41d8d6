"""Scene 40: hit the bar nearer to its axis or farther from it until the ball stops."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

SPEED = 3.0
START_X = -0.5
PARKED = (-3.0, 0.5, 0.0)
LOW, HIGH = 0.1, 1.0
PROBES = 9
FLIGHT_S = 0.35
"""From the start to shortly after the ball has parted from the bar."""
REST_S = 30.0


def _hit(y):
    """Send the ball at the bar, read its momentum per kg, take it away and let the bar come to rest."""
    return [
        call("move_object", object_id="object_1", x=START_X, y=y, z=0),
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=FLIGHT_S),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("move_object", object_id="object_1", x=PARKED[0], y=PARKED[1], z=PARKED[2]),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("step", duration=REST_S),
    ]


def solve(task):
    """Halve the range of distances by the sign of what is left of the momentum."""
    low, high = LOW, HIGH
    for _ in range(PROBES):
        y = sqrt(low * high)
        readings = yield _hit(y)
        low, high = (low, y) if readings[3]["momentum"]["x"] > 0 else (y, high)
    yield [answer(sqrt(low * high))]


def measure(engine, knobs):
    """The same search in the engine, much finer."""
    start = engine.save()
    low, high = LOW, HIGH
    for _ in range(24):
        y = sqrt(low * high)
        engine.restore(start)
        engine.place("object_1", np.array([START_X, y, 0.0]), {})
        engine.set_velocity("object_1", np.array([SPEED, 0.0, 0.0]))
        engine.step(engine.whole_steps(FLIGHT_S))
        low, high = (low, y) if engine.twist("object_1").linear[0] > 0 else (y, high)
    return sqrt(low * high)
