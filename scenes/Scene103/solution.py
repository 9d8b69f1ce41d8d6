"""Scene 103: spins of one wheel, two and three under growing loads; the laws of the resistances from the sums."""

from itertools import permutations

import numpy as np

from scenes.loads import GRAVITY, hung
from scenes.protocol import answer, call
from scenes.springs import resisted
from scenes.wheels import LoadedPan, left_spin, resisted_member

ARM, FAR_SPIN = 0.1, 40.0
BRAKE, SLOWEST = 10.0, 1.0
KINDS = ("even", "square", "late")
EDGES = (5.5, 8.0)
PAN = LoadedPan("object_4", 1.0)
FIRST_KG = 0.01
GOALS, ENOUGH = (2.5, 4.5, 6.5, 7.6, 8.6, 9.4), 9.1
"""Spins that are aimed at, and one that is enough, rad/s."""
AHEAD = (GOALS, GOALS, GOALS, GOALS[3:], GOALS[3:], ())
"""Spins that are aimed at after each load on the same wheels."""


def _columns(kind, spin, edge):
    """What the resistance is linear in."""
    return {"even": [spin], "square": [spin**2], "late": [spin, np.maximum(spin - edge, 0.0)]}[kind]


def _law(rows, structure):
    """Spins and torques; the parts of the torque by edge, and the torque of wheels 2 and 3 at the far spin."""
    spin, torque, there = rows[:, 0], rows[:, 1], rows[:, 2:]
    kinds = structure.split(", ")

    def parts(edge):
        table = [_columns(kind, spin, edge) for kind in kinds]
        return [column * there[:, wheel] for wheel, part in enumerate(table) for column in part]

    def far(found, edge):
        first, *others = (np.array(_columns(kind, FAR_SPIN, edge)) for kind in kinds)
        return float(np.dot(found, np.concatenate([0 * first, *others])))

    return parts, spin, torque, far


def _fitted(rows, structure):
    """Misfit, and torque at the far spin, with resistances of these kinds."""
    parts, spin, torque, far = _law(rows, structure)
    cost, found, edge = resisted(parts, spin, torque)
    return cost + 1e3 * float((found < 0).sum()), far(found, edge)


def _rows(exchanges):
    """Rows of spin, torque of the motor, and which wheels turn."""
    rows, there = [], [1.0, 0.0, 0.0]
    for asked, reading, load in hung(exchanges):
        if asked.tool == "attach_objects" and asked.arguments["object2_id"] == "object_1":
            there[int(asked.arguments["object1_id"][-1]) - 1] = 1.0
        elif asked.tool == "get_velocity" and SLOWEST < (spin := reading["angular_velocity"]) < BRAKE:
            rows.append((spin, ARM * GRAVITY * load[PAN.body], *there))
    return np.array(rows)


def _best(rows):
    """Torque of the second and the third wheel at the far spin, by the kinds that fit best."""
    return min(_fitted(rows, ", ".join(kinds)) for kinds in permutations(KINDS))[1]


def fit(readings, structure):
    """The far torque with resistances of these kinds."""
    return _fitted(_rows(readings), structure)[1]


def rivals(readings):
    """Each order of the kinds, fitted."""
    rows = _rows(readings)
    orders = (", ".join(kinds) for kinds in permutations(KINDS))
    return {order: resisted_member(*_law(rows, order), EDGES) for order in orders}


def _join(wheel):
    return [call("attach_objects", object1_id=wheel, object2_id="object_1")]


def solve(task):
    """Turn one wheel, two and three, each time up to just below the brake; each load follows from the spins before."""
    exchanges, number, kg = [], 0, FIRST_KG
    for first in ([], _join("object_2"), _join("object_3")):
        seen, rows = yield from PAN.turned(number, kg, first, AHEAD, ENOUGH)
        exchanges, number = exchanges + seen, number + len(rows) - 1
        kg = rows[-1][1] * GOALS[1] / max(rows[-1][0], 1.0)
    yield [answer(_best(_rows(exchanges)))]


def batch(task):
    """Four loads in even ratios on one wheel, three on two and on three, and the best fit."""
    calls, number = [], 0
    for wheels, first in enumerate(([], _join("object_2"), _join("object_3"))):
        calls += first
        for rung in range(4 - (wheels > 0)):
            calls += PAN.load(number, 0.1 * 3.0 ** (rung + wheels))
            number += 1
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 3 else 10.0)]


def stage(task):
    """Join all three wheels, and carry the torque of one spin over in proportion."""
    readings = yield [*_join("object_2"), *_join("object_3"), *PAN.load(0, FIRST_KG)]
    yield [answer(ARM * GRAVITY * FIRST_KG * FAR_SPIN / max(readings[-1]["angular_velocity"], 0.01) / 3)]


def structure(knobs):
    """Kinds of the three resistances."""
    return ", ".join(knobs["kinds"])


def _resistance(knobs, wheel, spin):
    kind, scale = knobs["kinds"][wheel - 1], knobs["scale"]
    if kind == "even":
        return scale * knobs["even"] * spin
    if kind == "square":
        return scale * knobs["square"] / 8 * spin**2
    return scale * knobs["late"] * (spin + knobs["more"] * max(spin - knobs["edge"], 0.0))


def naive(knobs):
    """The torque of both at 5 rad/s, carried over in proportion to the spin."""
    return {"in proportion": sum(_resistance(knobs, wheel, 5.0) for wheel in (2, 3)) * FAR_SPIN / 5}


def theory(knobs):
    """Sum of both resistances at the far spin."""
    return sum(_resistance(knobs, wheel, FAR_SPIN) for wheel in (2, 3))


def _pair(engine):
    """The engine with the second and the third wheel joined, without the first."""
    engine.remove("object_1")
    engine.join("object_2", "object_3", "weld")
    return engine


def measure(engine, knobs):
    """Torque at the far spin, where the engine's wheels 2 and 3 together come to a steady spin under a torque."""
    torque = theory(knobs)
    spin = FAR_SPIN * (1 + left_spin(_pair(engine), "object_2", "object_3", (torque,), FAR_SPIN, 15.0))
    return torque * torque / sum(_resistance(knobs, wheel, spin) for wheel in (2, 3))


def settles(engine, knobs, off):
    """The spin of the pair, brought to a spin near the asked one, under the asked torque."""
    near = sum(_resistance(knobs, wheel, FAR_SPIN * (1 + off)) for wheel in (2, 3))
    return left_spin(_pair(engine), "object_2", "object_3", (near, theory(knobs)), FAR_SPIN, 15.0)
