"""Scene 90: find the pace by ever longer steps, then swing and mass ratio from even looks at a fresh swing."""

from math import acos

import numpy as np

from scenes.protocol import answer, call

CARTS = ("object_1", "object_2")
KNOWN_KG = 2.0
APART_M, SHIFT_M = 1.0, 0.2
FIRST_S, GROWTH, GLANCES = 0.01, 1.25, 26
LOOKS_PER_SWING, LOOKS = 20, 30
STEP_S = 0.005


def _let_go():
    """Both at rest, the known cart farther away than the spring is long."""
    calls = []
    for cart, place in zip(CARTS, (-SHIFT_M, APART_M), strict=True):
        calls += [
            call("move_object", object_id=cart, x=place, y=0, z=1),
            call("set_velocity", object_id=cart, velocity_vector=[0, 0, 0]),
        ]
    return calls


def _look(duration):
    return [call("step", duration=duration), *(call("get_position", object_id=cart) for cart in CARTS)]


def _places(readings):
    """Places of both carts at each look, from where the spring is relaxed."""
    one, two = (np.array([look["position"][0] for look in readings[nth::3]]) for nth in (5, 6))
    return one, two - APART_M


def solve(task):
    """Stretch swings: next + before = 2 cos(ω pause) now. The ways of the carts are as their masses inversely."""
    pauses = [FIRST_S * GROWTH**turn for turn in range(GLANCES)]
    readings = yield [*_let_go(), *(one for pause in pauses for one in _look(pause))]
    one, two = _places(readings)
    passed = int(np.argmax(two - one < 0))
    times = np.concatenate([[0.0], np.cumsum(pauses)])
    quarter = (times[passed] + times[passed + 1]) / 2
    pause = max(round(4 * quarter / LOOKS_PER_SWING / STEP_S), 1) * STEP_S
    one, two = _places((yield [*_let_go(), *(look for _ in range(LOOKS) for look in _look(pause))]))
    x = two - one
    frequency = acos(float(x[1:-1] @ (x[2:] + x[:-2]) / (x[1:-1] @ x[1:-1])) / 2) / pause
    mass = -KNOWN_KG * float((one + SHIFT_M) @ (one + SHIFT_M) / ((one + SHIFT_M) @ two))
    yield [answer(frequency**2 * KNOWN_KG * mass / (KNOWN_KG + mass))]


def theory(knobs):
    """Stiffness ω² m₁ m₂ / (m₁ + m₂), as drawn."""
    return knobs["w"] ** 2 * KNOWN_KG * knobs["m2"] / (KNOWN_KG + knobs["m2"])


def measure(engine, knobs):
    """Force on the known cart over the stretch, from the speed it gains in one step in the engine."""
    shift = 0.1
    engine.place("object_1", np.array([-shift, 0.0, 1.0]), {})
    engine.step(1)
    gained = engine.twist("object_1").linear[0] / engine.timestep
    # On average over the step the stretch is less by (ω dt)² / 6 of itself.
    return float(KNOWN_KG * gained / shift / (1 - (knobs["w"] * engine.timestep) ** 2 / 6))
