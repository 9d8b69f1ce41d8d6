"""Scene 91: the fall with the ball and the slowing without it share out the energy."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
BALL_KG = 2.0
PAN_KG = 0.1
RADIUS = 0.1
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
ARM = 0.2
FALL = 1.0
PAN_Z = 5.0
SLOWING_S = 0.1
SETTLE_S = 0.1


def _look():
    return [call("get_position", object_id="object_2"), call("get_velocity", object_id="object_2")]


def _state(readings):
    return PAN_Z - readings[-2]["position"][2], -readings[-1]["velocity"][2]


def solve(task):
    """Load the pan, follow it to one metre in two steps, then take the ball away and watch it slow down."""
    ball_z = PAN_Z + RADIUS + 0.0005
    readings = yield [
        call("create_objects", name="load", pos=[0, 0, ball_z], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=0.3),
        *_look(),
    ]
    first_fallen, first_speed = fallen, speed = _state(readings)
    for _ in range(2):
        # Uniform acceleration: what is left takes this long.
        acceleration = speed**2 / (2 * fallen)
        wait = (sqrt(2 * acceleration * FALL) - speed) / acceleration
        if wait < 0.0025:
            break
        readings = yield [call("step", duration=wait), *_look()]
        fallen, speed = _state(readings)
    # Between two looks, so that the ball's settling into the pan does not count.
    acceleration = (speed**2 - first_speed**2) / (2 * (fallen - first_fallen))
    energy_per_kg = speed**2 / 2 + acceleration * (FALL - fallen)
    slowing = yield [
        call("delete_objects", object_id="load"),
        call("step", duration=SETTLE_S),
        *_look(),
        call("step", duration=SLOWING_S),
        *_look(),
    ]
    braking = (_state(slowing[:4])[1] - _state(slowing)[1]) / SLOWING_S
    # (m + p) g - f = a (X + m + p) and f - p g = b (X + p), with X = I / R².
    disk = (BALL_KG * GRAVITY - acceleration * (BALL_KG + PAN_KG) - braking * PAN_KG) / (acceleration + braking)
    yield [answer(disk * energy_per_kg)]


def theory(knobs):
    """E = X a h, with X = I / R² and a = ((m + p) g - τ / R) / (X + m + p)."""
    disk, moving = knobs["inertia"] / ARM**2, BALL_KG + PAN_KG
    return disk * (moving * GRAVITY - knobs["torque"] / ARM) / (disk + moving) * FALL


def measure(engine, knobs):
    """The engine's disk when the pan passes one metre, from its own speeds."""
    place, colour = np.array([0.0, 0.0, PAN_Z + RADIUS + 0.0005]), np.ones(4)
    engine.add_ball("load", place, DENSITY, RADIUS, colour, {})
    before = (0.0, 0.0)
    while True:
        engine.step(1)
        fallen = PAN_Z - engine.pose("object_2").position[2]
        energy = 0.5 * knobs["inertia"] * float(engine.twist("object_1").angular[1]) ** 2
        if fallen >= FALL:
            share = (FALL - before[0]) / (fallen - before[0])
            return float(before[1] + share * (energy - before[1]))
        before = (fallen, energy)
