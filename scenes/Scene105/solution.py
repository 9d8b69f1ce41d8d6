"""Scene 105: let both balls sink until their speeds stay the same."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
DENSITIES = (500.0, 2000.0)
SINK_S = 60.0
EDGE = sqrt(2.4) * RADIUS
"""Edge of the cube that has the ball's moments of inertia: the engine's drag is that of this cube."""


def solve(task):
    """Both at once, far enough apart."""
    readings = yield [
        *(
            call("create_objects", name=f"ball{i}", pos=[i, 0, 0], density=density, rgba=[1, 0, 0, 1], radius=RADIUS)
            for i, density in enumerate(DENSITIES)
        ),
        call("step", duration=SINK_S),
        call("get_velocity", object_id="ball0"),
        call("get_velocity", object_id="ball1"),
    ]
    yield [answer([-reading["velocity"][2] for reading in readings[-2:]])]


def theory(knobs):
    """Weight equals 3 π η d v + ρ d² v² / 2, with the edge d of the equivalent cube."""
    speeds = []
    for density in DENSITIES:
        weight = density * 4 / 3 * pi * RADIUS**3 * GRAVITY
        linear, square = 3 * pi * knobs["eta"] * EDGE, knobs["rho"] * EDGE**2 / 2
        speeds.append((sqrt(linear**2 + 4 * square * weight) - linear) / (2 * square))
    return speeds


def measure(engine, knobs):
    """Final speeds in the engine, of balls that sink one after the other."""
    start, speeds = engine.save(), []
    for density in DENSITIES:
        engine.restore(start)
        engine.add_ball("ball", np.zeros(3), density, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(SINK_S))
        speeds.append(float(-engine.twist("ball").linear[2]))
    return speeds
