"""Scene 50: push the float down step by step, find its shape and the rise of the level, and carry both on."""

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call
from scenes.steps import PushSteps, fitted_strengths, held_down

GAUGE, FLOAT = "object_1", "object_2"
ASKED, DEEPEST = 0.5, 0.2
SIGMA = 3e-4
"""Standard deviation of a place that is read, m."""
STEPS = PushSteps(
    bodies=(FLOAT, GAUGE),
    top_m=0.0,
    deepest=DEEPEST,
    enough=0.19,
    fastest=0.2,
    share=0.6,
    room=2.5,
    first_n=0.3,
    most=24,
    singly=6,
    look_s=0.025,
    wait_s=3.0,
    least_m=1e-3,
    least_m_s=2e-3,
)
SHAPES = {"prism": (), "wedge": ((0.15, 0.4),), "cone": ((0.15, 0.4),), "step": ((0.06, 0.16), (0.8, 5.0))}
"""Ranges of the draught or the edge of each shape, m, and of what the step adds to the cross-section, over it."""
WIDEST = 0.1
"""Largest cross-section of the float over that of the basin that is considered."""


def _columns(shape, depth, size):
    """Buoyancy of floats of unit strength over the further depth below the level."""
    depth = np.asarray(depth, dtype=float)
    columns = [depth]
    if shape == "wedge":
        columns = [depth + depth**2 / (2 * size)]
    elif shape == "cone":
        columns = [depth + depth**2 / size + depth**3 / (3 * size**2)]
    elif shape == "step":
        columns.append(np.maximum(depth - size, 0.0))
    return np.stack(columns, axis=-1)


def _held(shape, strengths, size, rise, asked=ASKED):
    """Force at a way down: where the buoyancy at the depth below the risen level equals it."""

    def pushed(level):
        return float((_columns(shape, [asked + level], size) @ np.asarray(strengths)).item())

    levels = np.linspace(0.0, 0.6, 301)
    first = next((level for level in levels[1:] if pushed(level) * rise < level), None)
    return pushed(brentq(lambda level: pushed(level) * rise - level, 0.0, first) if first is not None else 0.0)


def _fitted(rows, shape):
    """Misfit in standard deviations, strengths, size, and rise of the level per force."""
    forces, down, level = np.array(rows).T
    rise = float(level @ forces / (forces @ forces))

    def at(size):
        return *fitted_strengths(lambda u: _columns(shape, u, size), down + rise * forces, forces, SIGMA, 3), size

    sizes = np.linspace(*SHAPES[shape][0], 41) if SHAPES[shape] else (1.0,)
    return *min(map(at, sizes), key=lambda found: found[0]), max(rise, 0.0)


def _best(rows):
    """The force by the shape that fits best, each number paid for."""
    found = {shape: _fitted(rows, shape) for shape in SHAPES}
    shape = min(SHAPES, key=lambda shape: found[shape][0] + 5 * len(SHAPES[shape]))
    return _held(shape, *found[shape][1:])


def fit(readings, structure):
    """The force by one shape."""
    return _held(structure, *_fitted(STEPS.rows(readings), structure)[1:])


def _weighed(rows, shape):
    """One shape, fitted to the places of float and gauge.

    Constants: logarithm of the buoyancy per depth at the start, cross-section over the basin's, and those of the shape.
    """
    forces, down, level = np.array(rows).T

    def float_of(constants):
        k, sizes = np.exp(constants[0]), [*constants[2:], 1.0]
        return np.array([k, k * sizes[1]] if shape == "step" else [k]), sizes[0], constants[1] / k

    def misfits(constants):
        strengths, size, rise = float_of(constants)
        depth = down + rise * forces
        held, ahead = (_columns(shape, u, size) @ strengths for u in (depth, depth + 1e-5))
        return np.concatenate([(held - forces) / ((ahead - held) / 1e-5), rise * forces - level]) / SIGMA

    near = np.log(forces @ down / (down @ down))
    ranges = [(near - 3, near + 1), (0.0, WIDEST), *SHAPES[shape]]
    low, high = np.array(ranges).T
    starts = [low + (high - low) * [0.65, 0.2, *[share] * (len(low) - 2)] for share in (0.2, 0.5, 0.8)]
    fits = [least_squares(misfits, start, bounds=(low, high), x_scale=high - low) for start in starts]
    best = min(fits, key=lambda found: found.cost).x
    return member(misfits, lambda constants: _held(shape, *float_of(constants)), best, ranges)


def rivals(readings):
    """Floats of every shape, fitted."""
    rows = STEPS.rows(readings)
    return {shape: _weighed(rows, shape) for shape in SHAPES}


def solve(task):
    """Forces that grow step by step, first singly and watched, then two at a time."""
    yield [call("find_objects")]
    seen = yield from STEPS.pushed()
    yield [answer(_best(STEPS.rows(seen)))]


def stage(task):
    """Push with all force, and read where the float is."""
    readings = yield [call("find_objects"), STEPS.push(2400.0), *STEPS.rest()]
    yield [answer(2400.0 * ASKED / max(-readings[3]["position"][2], 0.01))]


def batch(task):
    """Forces in even ratios over the whole range, and the same fit."""
    calls = [call("find_objects")]
    for number in range(14):
        calls += [STEPS.push(0.5 * 1.75**number), *STEPS.rest()]
    rows = STEPS.rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 2 else 100.0)]


def _true(shape, knobs):
    """Strengths, size, and rise of the level per force."""
    strengths = [knobs["k"], knobs["kq"]] if shape == "step" else [knobs["k"]]
    return strengths, knobs["edge"] if shape == "step" else knobs["draught"], knobs["rise"]


def predict(structure, knobs):
    """Buoyancy below the risen level."""
    return _held(structure, *_true(structure, knobs))


def naive(knobs):
    """The force at 0.2 m in proportion; the buoyancy per depth at the start."""
    strengths, size, _ = _true(knobs["kind"], knobs)
    edge_force = float((_columns(knobs["kind"], [DEEPEST], size) @ np.asarray(strengths)).item())
    return {"in proportion": edge_force * ASKED / DEEPEST, "as at the start": knobs["k"] * ASKED}


def measure(engine, knobs):
    """The engine's float, held by a stiff hand at the asked place."""
    return held_down(engine, FLOAT, knobs["k"], ASKED, 0.0)


def settles(engine, knobs, off):
    """Where the float comes to rest under the asked force after it was near by."""
    free = engine.changed({"joint[device_joint].damping": 1e9})
    for way in (ASKED * (1 + off), ASKED):
        force = _held(knobs["kind"], *_true(knobs["kind"], knobs), way)
        free.push(FLOAT, force=np.array([0.0, 0.0, -force]))
        free.step(free.whole_steps(5.0))
    return -float(free.pose(FLOAT).position[2]) / ASKED - 1
