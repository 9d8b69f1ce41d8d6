"""Scene 50: a force that shifts the block well gives the spring, the swing after it the mass."""

from itertools import pairwise
from math import pi, sqrt

from scenes.protocol import answer, call

FIRST_N = 2.0
RAISE = 1.7
SHIFTED_M = 0.08
REST_S = 60.0
GLANCE_S = 0.02
LOOKS = 60
LOSS = 0.06
"""Damping ratio of a swing that loses a third of its width in a period: exp(-2π · 0.06) = 0.69."""


def _look(block, duration):
    return [call("step", duration=duration), call("get_position", object_id=block)]


def solve(task):
    """Raise the force, let go, estimate the period from a glance, then time two passages of the rest."""
    found = yield [call("find_objects")]
    block = found[0]["revealed"][0]["object_id"]
    force, x = FIRST_N / RAISE, 0.0
    while x < SHIFTED_M:
        force *= RAISE
        readings = yield [call("apply_force", object_id=block, force_vector=[force, 0, 0]), *_look(block, REST_S)]
        x = readings[-1]["position"][0]
    stiffness = force / x
    readings = yield [call("apply_force", object_id=block, force_vector=[0, 0, 0]), *_look(block, GLANCE_S)]
    # At first the block falls back by a t² / 2 with a = k x / m.
    moved = x - readings[-1]["position"][0]
    period = 2 * pi * sqrt(x * GLANCE_S**2 / (2 * moved))
    pause = max(round(period * 1.2 / LOOKS / 0.005), 1) * 0.005
    readings = yield [one for _ in range(LOOKS) for one in _look(block, pause)]
    places = [reading["position"][0] for reading in readings[1::2]]
    times = [
        pause * (step + before / (before - after))
        for step, (before, after) in enumerate(pairwise(places))
        if before * after < 0
    ]
    half = times[1] - times[0]
    yield [answer(stiffness * (half / pi) ** 2 * (1 - LOSS**2))]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """From ten half swings of the engine's block."""
    engine.push("object_2", force=[0.1 * knobs["k"], 0.0, 0.0])
    engine.step(engine.whole_steps(REST_S))
    engine.push("object_2", force=[0.0, 0.0, 0.0])
    times, before = [], 1.0
    while len(times) < 11:
        engine.step(1)
        x = float(engine.pose("object_2").position[0])
        if before * x < 0:
            times.append(engine.time - engine.timestep * x / (x - before))
        before = x
    return knobs["k"] * ((times[-1] - times[0]) / (10 * pi)) ** 2 * (1 - LOSS**2)
