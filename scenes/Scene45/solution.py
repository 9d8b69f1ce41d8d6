"""Scene 45: load the wheel step by step and unload it again; the way back tells which bends were slipping plates."""

from itertools import product
from math import cos

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, Lever
from scenes.protocol import answer, call

FARTHEST, ASKED = 1.2, 0.8
LEVER = Lever(
    widest=0.4,
    enough=0.37,
    fastest=0.07,
    share=0.76,
    room=3.5,
    first_kg=0.003,
    most=22,
    singly=6,
    look_s=0.05,
)
BACK = 9
"""Balls that are taken away again."""
SIGMA = 4e-4
"""Standard deviation of an angle that is read, rad."""
KINDS = {
    "plate": "P",
    "weight": "W",
    "two plates": "PP",
    "plate, then weight": "PW",
    "weight, then plate": "WP",
    "two weights": "WW",
}
GRID = np.arange(0.05, 0.27, 0.01)
BEND, STRENGTH, APART = (0.05, 0.27), (0.5, 2.5), 0.04
"""Ranges of the angles at which a part bends and of its stiffness over that of the spring; least distance of bends."""


def _stretches(angles, sort, bend):
    """Torque of a part of unit stiffness at the angles, which follow each other."""
    angles = np.asarray(angles, dtype=float)
    if sort == "W":
        return np.clip(angles, -bend, bend)
    torques, stretch = [], 0.0
    for change in np.diff(angles, prepend=0.0):
        stretch = min(max(stretch + change, -bend), bend)
        torques.append(stretch)
    return np.array(torques)


def _table(angles, sorts, bends):
    """Torques of unit stiffness at the angles: of the spring, then of each part."""
    return np.column_stack([angles, *(_stretches(angles, *part) for part in zip(sorts, bends, strict=True))])


def _misfits(rows, sorts, bends, strengths):
    """How far the loads are from the torques of all parts, in standard deviations of the angles."""
    loads, angles = np.array(rows).T
    table = _table(angles, sorts, bends)
    grows = np.clip((np.array(bends) - np.abs(table[:, 1:])) / (2 * SIGMA) + 0.5, 0.0, 1.0)
    slope = strengths[0] + grows @ np.maximum(strengths[1:], 0.0)
    return (table @ strengths - loads) / np.hypot(SIGMA * np.maximum(slope, 0.3 * abs(strengths[0])), 5e-4 * loads)


def _rough(rows, sorts, bends):
    """Chi-square and strengths of the best parts with these bends."""
    loads, angles = np.array(rows).T
    table = _table(angles, sorts, bends)
    error = SIGMA * np.max(loads) / np.max(angles) * np.where(angles < bends[0], 3.0, 1.0)
    strengths, *_ = np.linalg.lstsq(table / error[:, None], loads / error, rcond=None)
    strengths = np.maximum(strengths, 0.05 * np.max(strengths))
    return float((_misfits(rows, sorts, bends, strengths) ** 2).sum()), strengths


def _parts(constants):
    """Bends and strengths from the logarithm of the spring's strength, then strengths over it, first bend, distance."""
    scale, count = np.exp(constants[0]), len(constants) // 2
    strengths = scale * np.concatenate([[1.0], constants[1 : 1 + count]])
    return np.cumsum(constants[1 + count :]), strengths


def _fitted(rows, kind):
    """Misfits as a function of the constants, the best constants, and their ranges, for one kind of parts."""
    sorts = KINDS[kind]
    trials = [bends for bends in product(GRID, repeat=len(sorts)) if bends[-1] - bends[0] > APART or len(sorts) == 1]
    found = sorted(((*_rough(rows, sorts, bends), bends) for bends in trials), key=lambda fit: fit[0])[:3]
    middle = np.log(found[0][1][0])
    ranges = [(middle - 1.5, middle + 1.5), *[STRENGTH] * len(sorts), BEND, (APART, 0.22)][: 2 + 2 * len(sorts) - 1]

    def misfits(constants):
        return _misfits(rows, sorts, *_parts(constants))

    best = None
    for _, strengths, bends in found:
        begin = np.array([np.log(strengths[0]), *(strengths[1:] / strengths[0]), *np.diff(bends, prepend=0.0)])
        low, high = np.array(ranges).T
        got = least_squares(
            misfits, np.clip(begin, low + 1e-6, high - 1e-6), bounds=(low, high), diff_step=1e-4, max_nfev=60
        )
        if best is None or got.cost < best.cost:
            best = got
    return misfits, best.x, ranges


def _load(kind, bends, strengths):
    """The asked load: out to the farthest angle and back."""
    torque = (_table([FARTHEST, ASKED], KINDS[kind], bends) @ np.asarray(strengths))[1]
    return float(torque / (GRAVITY * LEVER.arm_m * cos(ASKED)))


def _member(rows, kind):
    misfits, best, ranges = _fitted(rows, kind)
    return member(misfits, lambda constants: _load(kind, *_parts(constants)), best, ranges)


def _best(rows):
    """The asked load by the simplest parts that fit."""
    found = {kind: _member(rows, kind) for kind in KINDS}
    return min(found.values(), key=lambda fit: fit.chi_square + 6 * fit.constants).answer


def rivals(readings):
    """Every kind of parts, fitted."""
    rows = LEVER.torques(readings)
    return {kind: _member(rows, kind) for kind in KINDS}


def fit(readings, structure):
    """The asked load by one kind of parts."""
    return _member(LEVER.torques(readings), structure).answer


def _back(number):
    return [call("delete_objects", object_id=f"ball{number}"), *LEVER.rest()]


def solve(task):
    """Balls that grow until the speed is near that of the safety device, then as large as it permits; and back."""
    seen, number = yield from LEVER.turned()
    calls = [item for other in range(number - 1, max(number - 1 - BACK, 0), -1) for item in _back(other)]
    seen += zip(calls, (yield calls), strict=True)
    yield [answer(_best(LEVER.torques(seen)))]


def stage(task):
    """Ask for a ball that is heavy enough for any strength, and read where it comes to rest."""
    readings = yield [*LEVER.ball(0, 200.0, 0.3), *LEVER.rest()]
    yield [answer(200.0 * ASKED / max(readings[-1].get("angle", 0.0), 1e-3))]


def batch(task):
    """Eleven balls, most of them of the same mass, joined and taken away again, and the best fit."""
    calls = []
    for number in range(11):
        calls += [*LEVER.ball(number, min(0.02 * 1.8**number, 0.35)), *LEVER.rest()]
    for number in range(10, 5, -1):
        calls += _back(number)
    rows = LEVER.torques(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 1 else 1.0)]


def _drawn(knobs):
    """Bends and strengths."""
    count = len(KINDS[knobs["kind"]])
    return (knobs["early"], knobs["late"])[:count], [knobs["scale"], knobs["k1"], knobs["k2"]][: 1 + count]


def naive(knobs):
    """The same way back as out; the greatest load within reach in proportion to the angle."""
    bends, strengths = _drawn(knobs)
    near, same = (_table([0.39, ASKED], "W" * len(bends), bends) @ np.array(strengths)).tolist()
    return {
        "same way back": same / (GRAVITY * LEVER.arm_m * cos(ASKED)),
        "in proportion": near / (GRAVITY * LEVER.arm_m * cos(0.39)) * ASKED / 0.39,
    }


def theory(knobs):
    """Balance of torques on the way back."""
    return _load(knobs["kind"], *_drawn(knobs))


def measure(engine, knobs):
    """The torque that holds the engine's wheel at the asked angle on the way back, without the safety device."""
    engine = engine.changed({"joint[device_joint].damping": 1e6})
    stiff, tick, goal, way = 60 * knobs["scale"], 1 / engine.whole_steps(1.0), 0.0, 1
    while True:
        wheel = engine.turn(LEVER.body)
        torque = stiff * (goal - wheel.angle)
        if way == 1 and wheel.angle >= FARTHEST:
            way = -1
        elif way == -1 and wheel.angle <= ASKED:
            return (torque - knobs["oil"] * wheel.spin) / (GRAVITY * LEVER.arm_m * cos(ASKED))
        left = FARTHEST - wheel.angle if way == 1 else wheel.angle - ASKED
        goal += way * tick * (0.3 if left > 0.05 else 0.008)
        engine.push(LEVER.body, torque=np.array([0.0, torque, 0.0]))
        engine.step(1)
