"""Scene 44: load the pan with ball after ball until it sinks at the speed asked for."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
WANTED = 2.0
FIRST_DENSITY = 700.0
SETTLE_S = 25.0
STOP_S = 12.0
PROBES = 12
NEAR = 0.002
"""Relative distance of a speed from the one wanted that is near enough."""


def _probe(name, pan_z, density):
    """A ball put into the pan, and the momentum of 1 kg of pan when the speed is steady; then the empty pan stops."""
    return [
        call("create_objects", name=name, pos=[0, 0, pan_z + RADIUS], density=density, rgba=[1, 0, 0, 1]),
        call("step", duration=SETTLE_S),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("delete_objects", object_id=name),
        call("step", duration=STOP_S),
        call("get_position", object_id="object_1"),
    ]


def _next(tried):
    """Where the two speeds next to the wanted one, or the last two below it, point to."""
    below = sorted(one for one in tried if one[1] < WANTED)
    above = sorted(one for one in tried if one[1] >= WANTED)
    (d1, v1) = below[-1]
    # The speed rises ever faster with the load: from below the chord asks for too much.
    (d2, v2) = above[0] if above else below[-2]
    chord = d1 + (WANTED - v1) * (d2 - d1) / (v2 - v1)
    if len(above) > 1:
        # Two points above the knee point to the answer from the other side.
        (d3, v3) = above[1]
        tangent = d2 + (WANTED - v2) * (d3 - d2) / (v3 - v2)
        if d1 < tangent < d2:
            return tangent
    return chord


def solve(task):
    """Close in on the density by the speeds of the balls before."""
    tried, density, pan_z = [(0.0, 0.0)], FIRST_DENSITY, 0.0
    for number in range(PROBES):
        readings = yield _probe(f"ball{number}", pan_z, density)
        speed, pan_z = -readings[2]["momentum"]["z"], readings[-1]["position"][2]
        if abs(speed / WANTED - 1) < NEAR:
            break
        tried.append((density, speed))
        density = _next(tried)
    yield [answer(density)]


def theory(knobs):
    """The load F with v = F / c1 + max(0, F - f0) / c2, as a density."""
    coupling, dry, drag = knobs["coupling"], knobs["dry"], knobs["drag"]
    load = WANTED * coupling
    if load > dry:
        load = (WANTED + dry / drag) / (1 / coupling + 1 / drag)
    return load / (GRAVITY * VOLUME)


def measure(engine, knobs):
    """Two steady speeds of the engine 2 % around the true load, and the line through them."""
    wanted = theory(knobs)
    start, points = engine.save(), []
    for density in (0.98 * wanted, 1.02 * wanted):
        engine.restore(start)
        engine.add_ball("ball", np.array([0.0, 0.0, RADIUS]), density, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(2 * SETTLE_S))
        points.append((density, -float(engine.twist("object_1").linear[2])))
    (d1, v1), (d2, v2) = points
    return d1 + (WANTED - v1) * (d2 - d1) / (v2 - v1)
