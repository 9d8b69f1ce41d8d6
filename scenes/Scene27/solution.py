"""Scene 27: load the plank so that its ends sink by chosen amounts, fit the props, predict beyond the latches."""

from itertools import product

import numpy as np

from scenes.courses import Channel, force, position
from scenes.family import member
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.steps import LateParts, fitted_from

HALF, LATCH, ASKED = 1.5, 0.06, 0.15
REACH = 0.054
RESOLUTION = 0.00003
"""Error of a height, and of an angle, by rounding."""
PLACES, RATIOS, GAPS = (0.5, 1.3), (0.4, 5.0), (0.015, 0.04)
"""Ranges of a loose prop: how far it is from the middle, its stiffness over that of all fixed ones, and its gap."""
WAIT_S = 5.0
LOOSE = {"left": (-1,), "right": (1,), "both": (-1, 1)}
"""Sides on which a prop stands apart."""
ROUNDS = (
    (0.0, ((0.5, 0.5), (0.8, 0.3), (0.3, 0.8), (0.6, -0.4))),
    (0.0, ((0.75, 0.75), (0.85, 0.4), (0.4, 0.85), (0.85, -0.3))),
    (0.5, ((0.85, 0.85), (-0.3, 0.9), (0.9, 0.6), (0.6, 0.9))),
    (0.7, ((0.95, 0.95), (0.95, 0.6), (0.6, 0.95), (0.95, 0))),
    (0.8, ((1, 1), (1, 0.2), (0.2, 1), (0, 1))),
    (0.9, ((1, 0.9), (1, 0.5), (0.5, 1), (0.9, 1))),
    (0.95, ((1, 0), (0, 1), (1, 1), (0.95, 0.95))),
    (0.95, ((1, 0.7), (0.7, 1), (1, -0.3), (-0.3, 1))),
)
"""How far the loose props of the fit so far are trusted, and sinkings of left and right end in shares of the reach."""

RIG = Rig(
    [force("object_1", 2), Channel("apply_torque", "object_1", "torque_vector", 1)],
    [position("object_1", 2), Channel("get_position", "object_1", "angle")],
    significant=6,
)


def _load(p, sides, height, angle):
    """Force and torque that hold the plank: fixed props as a linear law p[:3], then place, ratio, gap of others."""
    force, torque = p[0] * height + p[1] * angle, p[1] * height + p[2] * angle
    for number in range(len(sides)):
        place, ratio, gap = p[3 + 3 * number : 6 + 3 * number]
        push = ratio * p[0] * np.maximum(-gap - (height - place * angle), 0)
        force, torque = force - push, torque + place * push
    return force, torque


def _stiffness(p, sides, height, angle):
    """Matrices by which a small rise and tilt change force and torque, (n, 2, 2)."""
    found = np.array([[p[0], p[1]], [p[1], p[2]]]) + np.zeros((len(height), 1, 1))
    for number in range(len(sides)):
        place, ratio, gap = p[3 + 3 * number : 6 + 3 * number]
        bears = -gap - (height - place * angle) > 0
        found += ratio * p[0] * bears[:, None, None] * np.array([[1.0, -place], [-place, place**2]])
    return found


def _points(readings):
    """Forces, torques, heights and angles of rest, up to the latch."""
    course = RIG.course(readings)
    height, angle = course.readings.T - [[1.0], [0.0]]
    within = np.maximum(np.abs(height + HALF * angle), np.abs(height - HALF * angle)) <= LATCH
    count = len(height) if np.all(within) else int(np.argmin(within))
    return np.array([*course.controls[:count].T, height[:count], angle[:count]]) if count else np.zeros((4, 1))


def _linear(points):
    """Law of the fixed props alone from the smallest displacements."""
    force, torque, height, angle = points
    zero = np.zeros_like(height)
    rows = np.concatenate((np.column_stack([height, angle, zero]), np.column_stack([zero, height, angle])))
    weights = 1 / np.tile(0.002 + np.abs(height) + np.abs(angle), 2) ** 2
    near = np.sqrt(weights)[:, None]
    return np.linalg.lstsq(rows * near, np.concatenate((force, torque)) * near[:, 0], rcond=None)[0]


def _misfits(kind, points):
    """Parameters of the props → misfits of heights and tilts, in their errors."""
    force, torque, height, angle = points
    sides = LOOSE[kind]

    def misfits(p):
        held = _load(p, sides, height, angle)
        missing = np.stack([held[0] - force, held[1] - torque], axis=-1)
        return (np.linalg.solve(_stiffness(p, sides, height, angle), missing[..., None]) / RESOLUTION).ravel()

    return misfits


def _ranges(kind, points):
    """Ranges of the parameters of the props."""
    whole, _, tilting = _linear(points)
    whole, tilting = max(whole, 50.0), max(tilting, 20.0)
    loose = [(sorted((side * PLACES[0], side * PLACES[1])), RATIOS, GAPS) for side in LOOSE[kind]]
    return [(whole / 3, 3 * whole), (-2 * whole, 2 * whole), (tilting / 3, 3 * tilting), *(r for n in loose for r in n)]


def _fitted(kind, points):
    """Misfit and the parameters of the props that fit best."""
    misfits, ranges = _misfits(kind, points), np.array(_ranges(kind, points)).T
    first = np.clip(_linear(points), *ranges[:, :3])
    starts = [
        [*first, *(v for side in LOOSE[kind] for v in (side * place, 1.0, gap))]
        for place, gap in product((0.7, 1.1), (0.028, 0.038))
    ]
    sizes = [first[0], first[0], first[2], *(0.5, 1.0, 0.01) * len(LOOSE[kind])]
    return fitted_from(misfits, starts, ranges, sizes)


def _best(points):
    """The structure that fits best, with a price for each parameter, and its parameters."""
    fits = {kind: _fitted(kind, points) for kind in LOOSE}
    count = np.log(2 * len(points[0]))
    kind = min(fits, key=lambda name: fits[name][0] * 0.5 + 3 * len(LOOSE[name]) * count)
    return kind, fits[kind][1]


def _hung(p, sides, end):
    """Load at an end that makes it sink as asked: linear for each set of props that bear, and one set is consistent."""
    place = end * HALF
    for bears in product((True, False), repeat=len(sides)):
        matrix = np.array([[p[0], p[1], 1.0], [p[1], p[2], -place], [1.0, -place, 0.0]])
        right = np.array([0.0, 0.0, -ASKED])
        for number, bearing in enumerate(bears):
            x, ratio, gap = p[3 + 3 * number : 6 + 3 * number]
            stiffness = ratio * p[0]
            if bearing:
                matrix[:2, :2] += stiffness * np.array([[1.0, -x], [-x, x * x]])
                right[:2] -= stiffness * gap * np.array([1.0, -x])
        height, angle, load = np.linalg.solve(matrix, right)
        pressed = [-p[5 + 3 * n] - (height - p[3 + 3 * n] * angle) > 0 for n in range(len(sides))]
        if pressed == list(bears):
            return float(load)
    return float(load)


def _predict(kind, p):
    return [_hung(p, LOOSE[kind], end) for end in (1, -1)]


def _pressed(part, points):
    """How far the plank was below the top of a loose prop."""
    place, _, gap = part
    return -gap - (points[2] - place * points[3])


PROPS = LateParts(_pressed, least=0.001, times=3)


def _sunk(kind, p, trust, ends):
    """Load the plank so that both ends sink by shares of the reach, with loose props as far as they are trusted."""
    left, right = ends
    place = -REACH * (left + right) / 2, REACH * (right - left) / (2 * HALF)
    alone, held = (_load(p, sides, *place) for sides in ((), LOOSE.get(kind, ())))
    return RIG.leg([a + trust * (h - a) for a, h in zip(alone, held, strict=True)], WAIT_S)


def solve(task):
    """Weak forces for the scale, then chosen sinkings of the ends, farther as the props become known."""
    seen, push = yield from RIG.touched(-2, 6, WAIT_S, lambda reading: reading[0] < 1 - 0.0015)
    calls = RIG.leg((0, -push / 5), WAIT_S) + RIG.leg((push / 2, push / 6), WAIT_S)
    seen += zip(calls, (yield calls), strict=True)
    found = yield from PROPS.approached(
        seen, ROUNDS, _linear(_points(seen)), _sunk, lambda seen: (*_best(_points(seen)), _points(seen))
    )
    yield [answer(_predict(*found))]


def fit(readings, structure):
    """Both loads by the props of a structure."""
    return _predict(structure, _fitted(structure, _points(readings))[1])


def rivals(readings):
    """Loose props on either side or both, fitted."""
    points = _points(readings)
    return {
        kind: member(
            _misfits(kind, points),
            lambda p, kind=kind: _predict(kind, p),
            _fitted(kind, points)[1],
            _ranges(kind, points),
        )
        for kind in LOOSE
    }


def _true(knobs):
    fixed = [(knobs["k1"], knobs["x1"]), (knobs["k2"], knobs["x2"])]
    p = [sum(k for k, _ in fixed), -sum(k * x for k, x in fixed), sum(k * x * x for k, x in fixed)]
    for number, side in ((3, -1), (4, 1)):
        if side in LOOSE[knobs["kind"]]:
            p += [knobs[f"x{number}"], knobs[f"k{number}"] / p[0], knobs[f"g{number}"]]
    return p


def naive(knobs):
    """The fixed props alone; all props without gaps."""
    p = _true(knobs)
    closed = [0.0 if n > 2 and n % 3 == 2 else v for n, v in enumerate(p)]
    return {
        "weak loads in proportion": [_hung(p[:3], (), end) for end in (1, -1)],
        "no gaps": _predict(knobs["kind"], closed),
    }


def stage(task):
    """Press one end down as if a load hung on it."""
    readings = yield RIG.leg((-1200, 1800), WAIT_S)
    sunk = HALF * readings[-1]["angle"] - (readings[-1]["position"][2] - 1.0)
    load = 1200 * ASKED / max(sunk, 1e-4)
    yield [answer([load, load])]


def batch(task):
    """Five strengths, each by three ways of loading, the weakest first."""
    calls = []
    for newtons in (8, 24, 72, 200, 500):
        for pushes in ((-newtons, 0), (-newtons / 2, newtons / 2), (-newtons / 2, -newtons / 2)):
            calls += RIG.leg(pushes, WAIT_S)
    readings = yield calls
    yield [answer(_predict(*_best(_points(list(zip(calls, readings, strict=True))))))]


def theory(knobs):
    """Balance of force and torque at an end that has sunk as asked."""
    return _predict(knobs["kind"], _true(knobs))


def measure(engine, knobs):
    """Without the latches: load an end, let it come to rest, correct the load by how far it sank."""
    loads = []
    for end in (1, -1):
        free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0)})
        tried = [(0.0, 0.0)]
        load = 0.5 * knobs["k1"] * ASKED
        for _ in range(5):
            free.push("object_1", force=np.array([0.0, 0.0, -load]), torque=np.array([0.0, end * HALF * load, 0.0]))
            free.step(free.whole_steps(5.0))
            tried.append(
                (load, end * HALF * free.turn("object_1").angle - (float(free.pose("object_1").position[2]) - 1))
            )
            (load_a, sunk_a), (load_b, sunk_b) = tried[-2:]
            if abs(sunk_b - sunk_a) > 1e-7:
                load = load_b + (ASKED - sunk_b) * (load_b - load_a) / (sunk_b - sunk_a)
        loads.append(load)
    return loads
