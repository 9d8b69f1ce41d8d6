"""Scene 43: send ball after ball against the block, faster or slower, until one stops."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.2
DENSITY = 60.0
BALL_KG = 4 / 3 * pi * RADIUS**3 * DENSITY
GAP = 0.1
"""From the ball to the block at the start [m]."""
LOW, HIGH = 0.2, 12.0
PROBES = 12
CONTACT_S = 0.25
"""Longer than ball and block touch, shorter than the block's way back."""
REST_S = 40.0


def _flight(speed):
    """From the start to shortly after the ball has parted from the block."""
    return GAP / speed + CONTACT_S


def _hit(name, speed):
    """Create a ball before the block, send it, read its momentum, take it away and let the block come to rest."""
    return [
        call(
            "create_objects",
            name=name,
            pos=[-GAP - RADIUS, 0, 0],
            density=DENSITY,
            rgba=[1, 0, 0, 1],
            radius=RADIUS,
        ),
        call("set_velocity", object_id=name, velocity_vector=[speed, 0, 0]),
        call("step", duration=_flight(speed)),
        call("get_momentum", object_id=name, mass=BALL_KG),
        call("delete_objects", object_id=name),
        call("step", duration=REST_S),
    ]


def solve(task):
    """Halve the range of speeds by the sign of what is left of the momentum."""
    low, high = LOW, HIGH
    for probe in range(PROBES):
        speed = sqrt(low * high)
        readings = yield _hit(f"ball{probe}", speed)
        low, high = (low, speed) if readings[3]["momentum"]["x"] > 0 else (speed, high)
    yield [answer(sqrt(low * high))]


def measure(engine, knobs):
    """The same search in the engine, much finer."""
    engine.add_ball("ball", np.array([-GAP - RADIUS, 0.0, 0.0]), DENSITY, RADIUS, np.ones(4), {})
    start = engine.save()
    low, high = LOW, HIGH
    for _ in range(20):
        speed = sqrt(low * high)
        engine.restore(start)
        engine.set_velocity("ball", np.array([speed, 0.0, 0.0]))
        engine.step(engine.whole_steps(_flight(speed)))
        low, high = (low, speed) if engine.twist("ball").linear[0] > 0 else (speed, high)
    return sqrt(low * high)
