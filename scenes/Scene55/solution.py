"""Scene 55: a ball rolls if its speed is its spin times its radius."""

from math import hypot

import numpy as np

from scenes.protocol import answer, call

BALLS = ("object_1", "object_2")
RADIUS = 0.1
RUN_S = 0.8
ROLLING = 0.8
"""Least share of the speed that a rolling ball's surface makes up for."""


def _verdict(rolls):
    return "0" if all(rolls) else BALLS[rolls.index(True)] if any(rolls) else "neither"


def solve(task):
    """Spin from energy and angular momentum with one mass: ω = 2 E / L."""
    readings = yield [
        call("step", duration=RUN_S),
        *(
            call(tool, object_id=ball, **mass)
            for ball in BALLS
            for tool, mass in (
                ("get_velocity", {}),
                ("get_rotational_energy", {"mass": 1.0}),
                ("get_angular_momentum", {"mass": 1.0}),
            )
        ),
    ]
    rolls = []
    for velocity, energy, spin in zip(*(readings[i::3] for i in (1, 2, 3)), strict=True):
        rate = 2 * energy["rotational_energy"] / hypot(*spin["angular_momentum"].values())
        rolls.append(rate * RADIUS > ROLLING * hypot(*velocity["velocity"]))
    yield [answer(_verdict(rolls))]


def theory(knobs):
    """The ball that was drawn."""
    return f"object_{knobs['rolls']}" if knobs["rolls"] else "0"


def measure(engine, knobs):
    """The engine's own spins, earlier."""
    engine.step(engine.whole_steps(RUN_S / 2))
    twists = [engine.twist(ball) for ball in BALLS]
    return _verdict([bool(np.linalg.norm(t.angular) * RADIUS > ROLLING * np.linalg.norm(t.linear)) for t in twists])
