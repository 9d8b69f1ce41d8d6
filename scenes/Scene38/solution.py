"""Scene 38: turn the shaft faster or slower until the arm stands at 45°."""

from math import acos, cos, radians, sin, sqrt

import numpy as np

from scenes.protocol import answer, call

LENGTH = 0.5
HINGE_X = 0.1
WANTED = radians(45)
FIRST_TORQUE = 80.0
PULSE_S = 1.0
SETTLE_S = 6.0
SLOW, FAST = 1.0, 20.0
"""Rates [rad/s] far below and far above that sought."""
PROBES = 12
SHAFT_INERTIA = 40.0


def _turn(torque):
    """Turn the shaft for a second, let the arm settle; read torque, energy, momentum (per kg) and the bob's height."""
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, torque]),
        call("get_torque", object_id="object_1"),
        call("step", duration=PULSE_S),
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, 0]),
        call("step", duration=SETTLE_S),
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
        call("get_potential_energy", object_id="object_2", mass=1.0, gravity=1.0),
    ]


def _rate(readings):
    """The shaft's rate: twice the energy over the angular momentum."""
    return 2 * readings[5]["rotational_energy"] / readings[6]["angular_momentum"]["z"]


def _angle(readings):
    """The arm's angle from the vertical."""
    return acos(min(max(-readings[7]["potential_energy"] / LENGTH, -1.0), 1.0))


def solve(task):
    """Halve the range of rates; the torque for a change of rate follows from what the last torque did."""
    readings = yield _turn(FIRST_TORQUE)
    rate = _rate(readings)
    inertia = readings[1]["torque"]["z"] * PULSE_S / rate
    low, high = (rate, FAST) if _angle(readings) < WANTED else (SLOW, rate)
    for _ in range(PROBES):
        readings = yield _turn(inertia * (sqrt(low * high) - rate) / PULSE_S)
        rate = _rate(readings)
        low, high = (rate, high) if _angle(readings) < WANTED else (low, rate)
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """ω² r L m cos θ = m g L sin θ + band, at θ = 45°, with r = 0.1 m + L sin θ."""
    radius = HINGE_X + LENGTH * sin(WANTED)
    weight = knobs["g"] * sin(WANTED)
    return sqrt(weight * (1 + knobs["pull"]) / (radius * cos(WANTED)))


def measure(engine, knobs):
    """The engine's own rate: a torque of known size for a second, a long wait, and the arm's angle."""
    start = engine.save()
    low, high = 1.0, 30.0
    for _ in range(18):
        middle = sqrt(low * high)
        engine.restore(start)
        engine.push("object_1", torque=np.array([0.0, 0.0, SHAFT_INERTIA * middle / PULSE_S]))
        engine.step(engine.whole_steps(PULSE_S))
        engine.push("object_1", torque=np.zeros(3))
        engine.step(engine.whole_steps(2 * SETTLE_S))
        below = engine.pose("object_2").position[2] < -LENGTH * cos(WANTED)
        low, high = (middle, high) if below else (low, middle)
    return float(engine.twist("object_1").angular[2])
