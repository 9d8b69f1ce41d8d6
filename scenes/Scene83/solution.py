"""Scene 83: a torque raised until the bar tilts well weighs it; the swing after letting go gives the inertia."""

from math import atan2, sin

import numpy as np

from scenes.protocol import answer, call

AXLE_Z = 2.0
FIRST, RAISE = 0.02, 1.8
TILTED = 0.1
REST_S = 60.0
LOOK_S, LOOKS = 0.05, 40


def _torque(size):
    return call("apply_torque", object_id="object_1", torque_vector=[0, size, 0])


def _angle(reading):
    """Tilt towards -x, which a torque about y makes positive."""
    x, _, z = reading["position"]
    return atan2(-x, AXLE_Z - z)


def _own_frequency(angles):
    """Angular frequency without damping from even looks: next = p now - q before, exp(λ pause) the roots."""
    x = np.array(angles)
    (p, q), *_ = np.linalg.lstsq(np.column_stack([x[1:-1], -x[:-2]]), x[2:], rcond=None)
    return float(abs(np.log(np.roots([1, -p, q])[0]))) / LOOK_S


def solve(task):
    """Small tilts: neither the torque nor the swing is far from the small-angle law."""
    torque, tilt = FIRST / RAISE, 0.0
    while tilt < TILTED:
        torque *= RAISE
        rest = call("step", duration=REST_S)
        tilt = _angle((yield [_torque(torque), rest, call("get_position", object_id="object_1")])[-1])
    look = [call("step", duration=LOOK_S), call("get_position", object_id="object_1")]
    readings = yield [_torque(0), *(look * LOOKS)]
    # A swing of width θ is slower than a small one by 1 + θ² / 16.
    frequency = _own_frequency([_angle(one) for one in readings[2::2]]) * (1 + tilt**2 / 16)
    yield [answer(torque / sin(tilt) / frequency**2)]


def theory(knobs):
    """Moment of inertia m (k² + d²)."""
    return knobs["m"] * (knobs["k"] ** 2 + knobs["d"] ** 2)


def measure(engine, knobs):
    """Torque over angular acceleration in the engine, at the rest where nothing else turns the bar."""
    twist, pause = 1e-3 * knobs["m"], 0.01
    engine.push("object_1", torque=[0.0, twist, 0.0])
    engine.step(engine.whole_steps(pause))
    return float(twist * pause / engine.twist("object_1").angular[1])
