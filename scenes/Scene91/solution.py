"""Scene 91: read the speed at the mark, and get the inertia from the jump of the acceleration without the ball."""

from math import log, pi, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
BALL_KG = 2.0
HUNG_KG = 0.2
"""Pan and counterweight."""
RADIUS = 0.1
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
ARM = 0.2
FALL = 1.0
PAN_Z = 5.0
LOOKS = 3
NEAR = 0.02
"""About what a loaded pan travels in two time steps."""
SETTLE_S = 0.05
STEP_S = 0.005


def _step(duration):
    return [
        call("step", duration=duration),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_2"),
        call("get_acceleration", object_id="object_2"),
    ]


def _state(readings):
    """How far the pan has come down, its speed and its acceleration, downward positive."""
    place, speed, change = readings[-3:]
    return PAN_Z - place["position"][2], -speed["velocity"][2], -change["z"]


def solve(task):
    """Follow the loaded pan to the mark, then take the ball away and see how the acceleration jumps."""
    readings = yield [
        call("create_objects", name="load", pos=[0, 0, PAN_Z + RADIUS], density=DENSITY, rgba=[1, 0, 0, 1]),
        *_step(0.2),
    ]
    fallen, speed, loaded = _state(readings)
    for _ in range(LOOKS):
        # The pan cannot be there sooner, because its acceleration fades.
        left = max(FALL - fallen, 0.0)
        wait = 2 * left / (speed + sqrt(speed**2 + 2 * loaded * left))
        readings = yield _step(max(wait, STEP_S))
        fallen, speed, loaded = _state(readings)
    readings = yield [call("delete_objects", object_id="load"), *_step(SETTLE_S), *_step(SETTLE_S)]
    first, second = _state(readings[:5])[2], _state(readings)[2]
    alone = first * (first / second) ** (1 - STEP_S / (2 * SETTLE_S))
    # m g - r = a (X + m + h) and -r = b (X + h), with the same resistance r and X = I / R².
    disk = BALL_KG * (GRAVITY - loaded) / (loaded - alone) - HUNG_KG
    rest = min(max(FALL - fallen, -NEAR), NEAR)
    yield [answer(disk * (speed**2 / 2 + loaded * rest))]


def theory(knobs):
    """E = X v² / 2 where 1 m = M (F ln(F / (F - c v)) / c - v) / c; X = I / R², F = m g - τ / R, M = X + m + h."""
    disk = knobs["inertia"] / ARM**2
    drag = knobs["drag"] / ARM**2
    force = BALL_KG * GRAVITY - knobs["torque"] / ARM
    low, high = 0.0, force / drag
    for _ in range(60):
        speed = (low + high) / 2
        fallen = (disk + BALL_KG + HUNG_KG) / drag * (-force / drag * log(1 - drag * speed / force) - speed)
        low, high = (speed, high) if fallen < FALL else (low, speed)
    return disk * speed**2 / 2


def measure(engine, knobs):
    """The engine's disk when the pan passes one metre, from its own speeds."""
    engine.add_ball("load", np.array([0.0, 0.0, PAN_Z + RADIUS]), DENSITY, RADIUS, np.ones(4), {})
    before = (0.0, 0.0)
    while True:
        engine.step(1)
        fallen = PAN_Z - engine.pose("object_2").position[2]
        energy = 0.5 * knobs["inertia"] * float(engine.twist("object_1").angular[1]) ** 2
        if fallen >= FALL:
            share = (FALL - before[0]) / (fallen - before[0])
            return float(before[1] + share * (energy - before[1]))
        before = (fallen, energy)
