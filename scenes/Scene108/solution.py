"""Scene 108: spins of the wheel under growing loads, without and with press; both laws, and the torque far beyond."""

import numpy as np

from scenes.loads import GRAVITY, hung, torque_at_spin
from scenes.protocol import answer, call
from scenes.springs import resisted
from scenes.wheels import LoadedPan, left_spin, resisted_member

ARM, LEVER = 0.1, 10.0
ASKED_SPIN, ASKED_N = 20.0, 600.0
BRAKE, SLOWEST = 10.0, 0.6
KINDS = ("dry", "thick", "root")
EDGES = (5.5, 8.0)
MOTOR, BEARING = LoadedPan("object_2", 1.0), LoadedPan("object_3", -1.0, letter="p")
FIRST_KG, TURNS = 0.008, 8
GOALS, ENOUGH = (2.5, 4.5, 6.5, 7.6, 8.6, 9.4), 9.1
"""Spins that are aimed at, and one that is enough, rad/s."""
SAFE = 9.3
PRESS_N, LESS_N = 45.0, 15.0


def _columns(kind, spin, press, edge):
    """What the torque is linear in."""
    with_press = {
        "dry": press * np.tanh(spin / 0.15),
        "thick": press * spin,
        "root": np.sqrt(press) * spin / np.sqrt(spin + 0.01),
    }
    return [spin, np.maximum(spin - edge, 0.0), with_press[kind]]


def _law(rows, kind):
    """The parts of the torque by edge, spins and torques, and the torque at the asked spin and press."""
    spin, torque, press = rows.T

    def far(found, edge):
        return float(np.dot(found, _columns(kind, ASKED_SPIN, ASKED_N, edge)))

    return lambda edge: _columns(kind, spin, press, edge), spin, torque, far


def _fitted(rows, kind):
    """Misfit, and torque at the asked spin and press, with one kind."""
    parts, spin, torque, far = _law(rows, kind)
    cost, found, edge = resisted(parts, spin, torque)
    return cost + 1e3 * float((found < 0).sum()), far(found, edge)


def _rows(exchanges):
    """Rows of spin, torque of the motor, and force that presses the bearing."""
    return np.array(
        [
            (spin, ARM * GRAVITY * load[MOTOR.body], LEVER * GRAVITY * load[BEARING.body])
            for asked, reading, load in hung(exchanges)
            if asked.tool == "get_velocity" and SLOWEST < (spin := reading["angular_velocity"]) < BRAKE
        ]
    )


def _best(rows):
    """The torque by the kind that fits best."""
    return min(_fitted(rows, kind) for kind in KINDS)[1]


def fit(readings, structure):
    """The far torque with one kind of what comes with the press."""
    return _fitted(_rows(readings), structure)[1]


def rivals(readings):
    """Each kind of what comes with the press, fitted."""
    rows = _rows(readings)
    return {kind: resisted_member(*_law(rows, kind), EDGES) for kind in KINDS}


def solve(task):
    """Turn the free wheel up to just below the brake; then press it, and never load more than is surely safe."""
    exchanges, rows = yield from MOTOR.turned(0, FIRST_KG, [], [GOALS] * (TURNS - 1) + [()], ENOUGH)
    number, (spins, loads) = len(rows) - 1, np.array(rows).T
    top = float(np.interp(SAFE, spins, loads))
    calls, kg = BEARING.put(0, PRESS_N / LEVER / GRAVITY), 0.97 * top
    for _ in range(4):
        calls += MOTOR.load(number, kg)
        number += 1
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        spin, calls, held = readings[-1]["angular_velocity"], [], kg
        # What the press adds does not shrink with the spin.
        kg = 0.98 * top + 0.97 * max(kg - float(np.interp(spin, spins, loads)), 0.0)
        if kg < 1.06 * held:
            break
    for part in (0.8, 0.62, 0.47):
        calls += MOTOR.load(number, part * held)
        number += 1
    calls += BEARING.put(1, LESS_N / LEVER / GRAVITY)
    for part in (0.6, 0.4):
        calls += MOTOR.load(number, part * held)
        number += 1
    exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(_best(_rows(exchanges)))]


def batch(task):
    """Loads in even ratios on the pressed wheel, and the best fit."""
    calls = BEARING.put(0, PRESS_N / LEVER / GRAVITY)
    for rung in range(11):
        calls += MOTOR.load(rung, 0.06 * 1.6**rung)
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 3 else 10.0)]


def stage(task):
    """Load the motor at once with much."""
    readings = yield [*MOTOR.load(0, 20.0), *BEARING.put(0, 0.5), call("step", duration=5.0)]
    yield [answer(ARM * GRAVITY * 20.0 * ASKED_SPIN / max(readings[3]["angular_velocity"], 0.5))]


def _torque(knobs, spin, press):
    kind, scale = knobs["kind"], knobs["scale"]
    with_press = {"dry": press / 45 * 5, "thick": press / 45 * spin, "root": (press * 5 * spin / 45) ** 0.5}
    return scale * (spin + knobs["more"] * max(spin - knobs["edge"], 0.0) + knobs["press"] * with_press[kind])


def naive(knobs):
    """The torque at 5 rad/s and 45 N, carried over in proportion to the spin, and what the press adds also to it."""
    free, pressed = _torque(knobs, 5.0, 0.0), _torque(knobs, 5.0, 45.0)
    more = pressed - free
    return {
        "in proportion": free * ASKED_SPIN / 5 + more * ASKED_N / 45 * ASKED_SPIN / 5,
        "without the change": _torque({**knobs, "more": 0.0}, ASKED_SPIN, ASKED_N),
    }


def theory(knobs):
    """The resistance at the asked spin and press."""
    return _torque(knobs, ASKED_SPIN, ASKED_N)


def _pressed(engine):
    """The engine without the brake, with a force on the pan that presses the bearing as asked."""
    free = engine.changed({"body[trigger]/inertial.mass": 1e12})
    free.push(BEARING.body, force=np.array([0.0, 0.0, -ASKED_N / LEVER]))
    return free


def measure(engine, knobs):
    """Torque at which the engine's wheel, pressed, keeps the asked spin."""
    scale = knobs["scale"]
    return torque_at_spin(_pressed(engine), MOTOR.wheel, ASKED_SPIN, 4 * scale, 0.1 * scale)


def settles(engine, knobs, off):
    """The spin of the pressed wheel, brought to a spin near the asked one, under the asked torque."""
    torques = (_torque(knobs, ASKED_SPIN * (1 + off), ASKED_N), theory(knobs))
    return left_spin(_pressed(engine), MOTOR.wheel, MOTOR.wheel, torques, ASKED_SPIN, 15.0)
