"""Scene 48: push the head step by step below the speed of the device, find the springs, and carry their law on."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call
from scenes.steps import PushSteps, fitted_strengths, held_down

FOOT, HEAD = "object_1", "object_2"
TOP, OUT, ROD = 0.6, 0.8, 1.0
ASKED, DEEPEST = 0.45, 0.12
SIGMA = 1.2e-4
"""Standard deviation of a way that is read, m."""
STEPS = PushSteps(
    bodies=(HEAD,),
    top_m=TOP,
    deepest=DEEPEST,
    enough=0.114,
    fastest=0.045,
    share=0.85,
    room=3.5,
    first_n=0.1,
    most=20,
    singly=6,
    look_s=0.06,
    wait_s=5.0,
    least_m=5e-4,
    least_m_s=5e-4,
)
KINDS = {"stiff foot": 2, "late foot": 3, "even foot and head": 2}
"""How many numbers describe each kind of springs."""
EDGES = np.arange(0.03, 0.0601, 0.001)
TOLD = 0.07
"""Way of the foot at which the part with the cube is told to be a third of the force at least, m."""
PARTS = {
    "stiff foot": ((1 / 3, 1.0),),
    "late foot": ((1.0, 6.0), (0.03, 0.06)),
    "even foot and head": ((0.05, 1.0),),
}
"""Ranges: share of the cube there; further stiffness over k, and its edge; stiffness at the head over k."""


def _columns(kind, down, edge):
    """Forces on the head for springs of unit strength."""
    high = TOP - np.asarray(down, dtype=float)
    foot = np.sqrt(ROD**2 - high**2)
    way, slope = foot - OUT, high / foot
    second = {"stiff foot": way**3 * slope, "late foot": np.maximum(way - edge, 0.0) * slope}
    return np.stack([way * slope, second.get(kind, TOP - high)], axis=-1)


def _held(kind, strengths, edge):
    """Force at the asked place."""
    return float((_columns(kind, [ASKED], edge) @ np.asarray(strengths)).item())


def _fitted(rows, kind):
    """Misfit in standard deviations, strengths, and the way from which a further spring acts."""
    forces, down = np.array(rows).T

    def at(edge):
        return *fitted_strengths(lambda places: _columns(kind, places, edge), down, forces, SIGMA, 4), edge

    return min(map(at, EDGES if kind == "late foot" else (1.0,)), key=lambda found: found[0])


def fit(readings, structure):
    """The force by springs of one kind."""
    return _held(structure, *_fitted(STEPS.rows(readings), structure)[1:])


def _weighed(rows, kind):
    """Springs of one kind, fitted: the logarithm of the stiffness at the foot, and the parts of `PARTS`."""
    forces, down = np.array(rows).T

    def springs(constants):
        k, part = np.exp(constants[0]), constants[1]
        second = k * (part / (1 - part) / TOLD**2 if kind == "stiff foot" else part)
        return np.array([k, second]), constants[2] if kind == "late foot" else 1.0

    def misfits(constants):
        strengths, edge = springs(constants)
        table, ahead = (_columns(kind, places, edge) @ strengths for places in (down, down + 1e-5))
        return (table - forces) / (np.maximum(ahead - table, 0.1 * np.max(ahead - table)) / 1e-5 * SIGMA)

    alone = _columns(kind, down, 1.0)[:, 0]
    near = np.log(alone @ forces / (alone @ alone))
    ranges = [(near - 3, near + 1), *((low, high - 1e-3) for low, high in PARTS[kind])]
    low, high = np.array(ranges).T
    starts = [low + (high - low) * [0.6, *[share] * (len(low) - 1)] for share in (0.2, 0.4, 0.7)]
    fits = [least_squares(misfits, start, bounds=(low, high), x_scale=high - low) for start in starts]
    best = min(fits, key=lambda found: found.cost).x
    return member(misfits, lambda constants: _held(kind, *springs(constants)), best, ranges)


def _best(rows):
    """The force by the springs that fit best within what the task tells of them, each number paid for."""
    found = {kind: _weighed(rows, kind) for kind in KINDS}
    return found[min(KINDS, key=lambda kind: found[kind].chi_square + 5 * KINDS[kind])].answer


def rivals(readings):
    """Springs of every kind, fitted."""
    rows = STEPS.rows(readings)
    return {kind: _weighed(rows, kind) for kind in KINDS}


def solve(task):
    """Forces that grow step by step, first singly and watched, then two at a time."""
    yield [call("find_objects")]
    seen = yield from STEPS.pushed()
    yield [answer(_best(STEPS.rows(seen)))]


def stage(task):
    """Push with more and more force until the head goes through."""
    calls = [call("find_objects")]
    for number in range(14):
        calls += [STEPS.push(0.05 * 2.0**number), *STEPS.rest()]
    readings = yield calls
    ways = [reading["position"][2] for reading in readings if "position" in reading]
    through = next((number for number, height in enumerate(ways) if height < TOP - DEEPEST), 13)
    yield [answer(0.05 * 2.0**through)]


def batch(task):
    """Forces in even ratios over the whole range, and the same fit."""
    calls = [call("find_objects")]
    for number in range(19):
        calls += [STEPS.push(0.06 * 1.5**number), *STEPS.rest()]
    rows = STEPS.rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 2 else 10.0)]


def predict(structure, knobs):
    """Work of the push is work on the springs."""
    return _held(structure, *_true(structure, knobs))


def _true(kind, knobs):
    """Strengths of the springs, and the way from which a further one acts."""
    second = {"stiff foot": "k3", "late foot": "kq", "even foot and head": "kh"}[kind]
    return [knobs["k"], knobs[second]], knobs["s"]


def naive(knobs):
    """The force at the end of the laboratory's range; an even spring of the foot that needs the same force there."""
    strengths, edge = _true(knobs["kind"], knobs)
    edge_force = (_columns(knobs["kind"], [DEEPEST], edge) @ np.array(strengths)).item()
    even = edge_force / _columns("late foot", [DEEPEST], 1.0)[0, 0]
    return {"force at 0.12 m": edge_force, "even spring": _held("late foot", [even, 0.0], 1.0)}


def measure(engine, knobs):
    """The engine's head, held by a stiff hand at the asked place."""
    return held_down(engine, HEAD, knobs["k"], ASKED, TOP)
