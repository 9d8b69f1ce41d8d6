"""Scene 39: let the ball go from different places until the next peak on the same side is half as far."""

from math import exp, log, pi, sqrt

import numpy as np

from scenes.protocol import answer, call

NUDGE = 0.1
LOW, HIGH = 0.02, 5.0
PROBES = 9
SHARE = 0.5


def _release(place, duration):
    """Let go from rest at a place, and read place, momentum per kg and force per kg some time later."""
    return [
        call("move_object", object_id="object_1", x=place, y=0, z=0),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("step", duration=duration),
        call("get_position", object_id="object_1"),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("compute_force", object_id="object_1", mass=1.0),
    ]


def _peak(readings):
    """The turning point next to where the ball was read: x + v² / 2|a|."""
    place, speed, change = readings[3]["position"][0], readings[4]["momentum"]["x"], readings[5]["x"]
    return place - speed**2 / (2 * change)


def solve(task):
    """Period from the pull right after a release; then false position on the logarithms of place and share."""
    readings = yield _release(NUDGE, 0.005)
    period = 2 * pi / sqrt(-readings[5]["x"] / NUDGE)
    low, high = log(LOW), log(HIGH)
    at_low = at_high = None
    for _ in range(PROBES):
        middle = (low + high) / 2
        if at_low is not None and at_high is not None and at_low - at_high < 1.0:
            middle = low + (high - low) * min(max(at_low / (at_low - at_high), 0.1), 0.9)
        place = exp(middle)
        readings = yield _release(place, period)
        excess = log(_peak(readings) / place / SHARE)
        if excess > 0:
            low, at_low = middle, excess
        else:
            high, at_high = middle, excess
    yield [answer(exp(middle))]


def _next_peak(engine, place, period):
    """The engine's own next peak on the same side, followed step by step."""
    engine.place("object_1", np.array([place, 0.0, 0.0]), {})
    engine.set_velocity("object_1", np.zeros(3))
    engine.step(engine.whole_steps(0.8 * period))
    speed = engine.twist("object_1").linear[0]
    while speed > 0:
        before = speed
        engine.step(1)
        speed = engine.twist("object_1").linear[0]
    return engine.pose("object_1").position[0] + speed**2 * engine.timestep / (2 * (before - speed))


def measure(engine, knobs):
    """The same search by halving in the engine, much finer."""
    period = 2 * pi * sqrt(knobs["mass"] / knobs["k"])
    low, high = log(LOW), log(HIGH)
    for _ in range(16):
        middle = (low + high) / 2
        left = _next_peak(engine, exp(middle), period) / exp(middle)
        low, high = (middle, high) if left > SHARE else (low, middle)
    return exp((low + high) / 2)
