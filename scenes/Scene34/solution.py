"""Scene 34: pump the wheel up, take angle, spin and work as points of its energy, fit weight and cords, predict."""

from math import pi, sqrt

import numpy as np

from scenes.courses import Channel
from scenes.loads import GRAVITY
from scenes.protocol import answer
from scenes.pumping import Pump
from scenes.rigs import Rig
from scenes.works import cheapest, guesses, refitted, weighed, whitening, work_points

PAWL, TORQUE = 2.2, 0.13
ANGLE_ERROR, SPIN_ERROR = 0.0012, 0.003
REACH, MEMBERS = 2.08, 30
"""How far the pumping may go, by so many plausible potentials; an unknown cord can only stop the wheel earlier."""
LUMP_KG, LUMP_M = 0.5, 0.4
LOOKS, FEW_LOOKS = (0.4, 0.7, 1.0), (1.0,)
"""When to look, in shares of a half swing: of a wide one, and of one that does not come so far."""
WIDE = 1.1
SLOW = 0.05
"""Below this torque nothing holds the wheel off the top, in N·m."""
NAMES = ("inertia", "weight", "kp", "from_plus", "km", "from_minus", "kt")
FREE = {"plus": (0, 1, 2, 3), "minus": (0, 1, 4, 5), "both": (0, 1, 2, 3, 4, 5), "torsion": (0, 1, 6)}
"""Which of the parameters a structure has; the others are 0."""
GUESS = np.array([0.13, 1.0, 1.8, 1.0, 1.8, 1.0, 0.7])
HIGHEST = np.array([2.0, 10.0, 20.0, 1.5, 20.0, 1.5, 10.0])


RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 1)],
    [Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")],
)


def _potential(p, angle):
    """Potential energy of weight, cords and torsion spring, in J."""
    angle = np.asarray(angle)
    return (
        p[1] * (1 - np.cos(angle))
        + p[2] * np.maximum(angle - p[3], 0) ** 2 / 2
        + p[4] * np.maximum(-angle - p[5], 0) ** 2 / 2
        + p[6] * angle**2 / 2
    )


def _looks(end):
    return LOOKS if abs(end) > WIDE else FEW_LOOKS


PUMP = Pump(RIG, _potential, lambda p: p[0], TORQUE, REACH, _looks, calls=148, time_s=25.9, singly=6)


def _slope(p, angle):
    return (_potential(p, angle + 1e-5) - _potential(p, angle - 1e-5)) / 2e-5


def _excess(p, angle, spin):
    """Energy of the wheel, in J."""
    return p[0] * spin**2 / 2 + _potential(p, angle)


def _variances(p, angle, spin, torque):
    """Variance of the energy at each point by itself, in J²."""
    return (p[0] * spin * SPIN_ERROR) ** 2 + ((_slope(p, angle) - torque) * ANGLE_ERROR) ** 2 + 1e-8


def _fitted(kind, readings):
    """The fit of a structure to the points; errors of the work are carried on from turn to turn."""
    angle, spin, work, torque, doubt = work_points(readings, RIG, ANGLE_ERROR, PAWL)
    free = list(FREE[kind])

    def alone(p):
        return _variances(p, angle, spin, torque)

    def misfits(p):
        return _excess(p, angle, spin) - work, (p[free] - GUESS[free]) / (8 * GUESS[free])

    starts = guesses(GUESS, free, (3, 5), (0.8, 1.2))
    return refitted(starts, free, doubt, alone, misfits, GUESS, HIGHEST, 1e-6)


def _best(readings, kinds=tuple(FREE)):
    """The fit of the best structure, with a price for each parameter."""
    count = len(work_points(readings, RIG, ANGLE_ERROR, PAWL)[0])
    return cheapest({kind: _fitted(kind, readings) for kind in kinds}, count)


def _predict(p):
    """Least spins at the bottom, to the top on either side, with the lump."""
    lump = 2 * LUMP_KG * GRAVITY * LUMP_M
    inertia = p[0] + LUMP_KG * LUMP_M**2
    return [sqrt(2 * (float(_potential(p, side * pi)) + lump) / inertia) for side in (1, -1)]


def solve(task):
    """A torque to begin with, then half swings that no plausible potential leads too far."""
    seen = yield from PUMP.pumped(
        RIG.along(TORQUE, (0.15, 0.3, 0.45, 0.65)), lambda seen: _best(seen, ("both", "torsion")).plausible(MEMBERS)
    )
    yield [answer(_predict(_best(seen).constants))]


def fit(readings, structure):
    """Both spins by the cords or the spring of a structure."""
    return _predict(_fitted(structure, readings).constants)


def rivals(readings):
    """The cords or the spring of each structure, fitted with the errors that follow from the best of them."""
    angle, spin, work, torque, doubt = work_points(readings, RIG, ANGLE_ERROR, PAWL)
    fits = {kind: _fitted(kind, readings) for kind in FREE}
    best = cheapest(fits, len(angle)).constants
    return weighed(
        fits,
        whitening(doubt, _variances(best, angle, spin, torque)),
        lambda p: _excess(p, angle, spin) - work,
        _predict,
        HIGHEST,
    )


def _true(knobs):
    return np.array([knobs[name] for name in NAMES], dtype=float)


def naive(knobs):
    """Weight alone; weight and inertia of the lump left out; the side with less taken for both."""
    p = _true(knobs)
    small = 2 * sqrt((p[1] + p[6] + LUMP_KG * GRAVITY * LUMP_M) / (p[0] + LUMP_KG * LUMP_M**2))
    alone = [sqrt(2 * float(_potential(p, side * pi)) / p[0]) for side in (1, -1)]
    return {"pendulum of small swings": [small, small], "without the lump": alone}


def stage(task):
    """Turn as hard as possible for long and take the greatest spin."""
    readings = yield RIG.leg(TORQUE, 2.4, looks=8)
    spins = [abs(reading["angular_velocity"]) for reading in readings if "velocity" in reading]
    yield [answer([max(spins), max(spins)])]


def batch(task):
    """Torques to and fro with a usual period, looked at evenly."""
    calls = [asked for number in range(6) for asked in RIG.leg(TORQUE * (-1) ** number, 0.9, looks=3)]
    readings = yield calls
    yield [answer(_predict(_best(list(zip(calls, readings, strict=True))).constants))]


def theory(knobs):
    """The energy at the top over the inertia, with the lump."""
    return _predict(_true(knobs))


def measure(engine, knobs):
    """With the lump and without the pawl: held near the top on either side, let go, spin at the bottom."""
    p = _true(knobs)
    mass = knobs["mass"] + LUMP_KG
    depth = (knobs["weight"] / GRAVITY + LUMP_KG * LUMP_M) / mass
    own = knobs["inertia"] + LUMP_KG * LUMP_M**2 - mass * depth**2
    changes = {
        "body[pawl].pos": (0.0, 0.0, 0.0),
        "body[object_1]/inertial.mass": mass,
        "body[object_1]/inertial.pos": (0.0, 0.0, -depth),
        "body[object_1]/inertial.diaginertia": (own, own, own),
    }
    spins = []
    for side in (1, -1):
        free = engine.changed(changes)
        held = float(_slope(p, side * pi))
        top = side * (pi if abs(held) > SLOW else pi - 0.02)
        for _ in range(free.whole_steps(6.0)):
            now = free.turn("object_1")
            free.push("object_1", torque=np.array([0.0, held + 60 * (top - now.angle) - 10 * now.spin, 0.0]))
            free.step(1)
        free.push("object_1", torque=np.zeros(3))
        before = now = free.turn("object_1")
        while now.angle * side > 0:
            free.step(1)
            before, now = now, free.turn("object_1")
        share = before.angle / (before.angle - now.angle)
        spins.append(abs(before.spin + share * (now.spin - before.spin)))
    return spins
