"""Scene 50: push the float down step by step, find its shape and the rise of the level, and carry both on."""

import numpy as np
from scipy.optimize import brentq

from scenes.protocol import answer, call

GAUGE, FLOAT = "object_1", "object_2"
ASKED, DEEPEST, FASTEST = 0.5, 0.2, 0.2
SIGMA = 3e-4
"""Standard deviation of a place that is read, m."""
FIRST_N, LOOK_S, WAIT_S = 0.3, 0.025, 3.0
SINGLY, MOST, LAST = 6, 24, 0.19
"""Steps that are made one by one and watched, most steps, and the way that is enough."""
SHAPES = {"prism": (1, (1.0,)), "wedge": (2, np.arange(0.15, 0.405, 0.005)), "cone": (2, np.arange(0.15, 0.405, 0.005))}
SHAPES["step"] = (3, np.arange(0.04, 0.181, 0.004))
"""How many numbers describe each shape, and trial values of its draught or edge, m."""


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


def _held(shape, strengths, size, rise):
    """Force at the asked place: where the buoyancy at the depth below the risen level equals it."""

    def lack(level):
        return float((_columns(shape, [ASKED + level], size) @ np.asarray(strengths)).item()) * rise - level

    levels = np.linspace(0.0, 0.6, 301)
    first = next((level for level in levels[1:] if lack(level) < 0), None)
    level = brentq(lack, 0.0, first) if first is not None else 0.0
    return float((_columns(shape, [ASKED + level], size) @ np.asarray(strengths)).item())


def _fitted(rows, shape):
    """Misfit in standard deviations, strengths, size, and rise of the level per force."""
    forces, down, level = np.array(rows).T
    rise = float(level @ forces / (forces @ forces))
    depth, best = down + rise * forces, None
    for size in SHAPES[shape][1]:
        table, ahead = _columns(shape, depth, size), _columns(shape, depth + 1e-5, size)
        slope = np.full(len(depth), float(forces @ depth / (depth @ depth)))
        for _ in range(3):
            error = SIGMA * slope
            strengths = np.linalg.lstsq(table / error[:, None], forces / error, rcond=None)[0]
            slope = np.maximum((ahead - table) @ strengths / 1e-5, 0.1 * np.max(slope))
        misfit = float((((table @ strengths - forces) / error) ** 2).sum()) + 1e4 * float(min(strengths) < 0)
        if best is None or misfit < best[0]:
            best = (misfit, strengths, size, max(rise, 0.0))
    return best


def _best(rows):
    """The force by the shape that fits best, each number paid for."""
    found = {shape: _fitted(rows, shape) for shape in SHAPES}
    shape = min(SHAPES, key=lambda shape: found[shape][0] + 5 * SHAPES[shape][0])
    return _held(shape, *found[shape][1:])


def _rows_of(exchanges):
    """Force, way of the float and rise of the level wherever all was at rest, until the water is let out."""
    force, last, down, rows = 0.0, 0.0, 0.0, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = -asked.arguments["force_vector"][2]
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position" and last > 1.0:
            if asked.arguments["object_id"] == FLOAT:
                down = -reading["position"][2]
                if down > DEEPEST:
                    break
            else:
                rows.append((force, down, reading["position"][2]))
    return rows


def fit(readings, structure):
    """The force by one shape."""
    return _held(structure, *_fitted(_rows_of(readings), structure)[1:])


def _push(force):
    return call("apply_force", object_id=FLOAT, force_vector=[0, 0, -float(f"{force:.5g}")])


def _rest():
    return [call("step", duration=WAIT_S), *(call("get_position", object_id=body) for body in (FLOAT, GAUGE))]


def solve(task):
    """Forces that grow step by step, first singly and watched, then two at a time."""
    yield [call("find_objects")]
    exchanges, force, more, number, way = [], 0.0, FIRST_N, 0, 0.0
    allowed, gained = np.inf, 0.0
    while number < MOST and way < LAST:
        before, calls, count = way, [], 1 if number < SINGLY or DEEPEST - way < 2.5 * gained else 2
        for _ in range(count):
            force += more
            look = [call("step", duration=LOOK_S), call("get_velocity", object_id=FLOAT)] if number < SINGLY else []
            calls += [_push(force), *look, *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        way = _rows_of(exchanges)[-1][1]
        if number < SINGLY:
            allowed = 0.6 * FASTEST * more / max(-readings[2]["velocity"][2], 0.002)
        number += count
        gained = max((way - before) / count, 1e-3)
        more = min(8 * more, allowed, 0.75 * more * max(DEEPEST - way, 1e-3) / gained)
    yield [answer(_best(_rows_of(exchanges)))]


def stage(task):
    """Push with all force, and read where the float is."""
    readings = yield [call("find_objects"), _push(2400.0), *_rest()]
    yield [answer(2400.0 * ASKED / max(-readings[3]["position"][2], 0.01))]


def batch(task):
    """Forces in even ratios over the whole range, and the same fit."""
    calls = [call("find_objects")]
    for number in range(14):
        calls += [_push(0.5 * 1.75**number), *_rest()]
    readings = yield calls
    rows = _rows_of(list(zip(calls, readings, strict=True)))
    yield [answer(_best(rows) if len(rows) > 2 else 100.0)]


def structure(knobs):
    """Shape of the float."""
    return knobs["kind"]


def _true(knobs):
    """Strengths, size, and rise of the level per force."""
    strengths = [knobs["k"], knobs["kq"]] if knobs["kind"] == "step" else [knobs["k"]]
    return strengths, knobs["edge"] if knobs["kind"] == "step" else knobs["draught"], knobs["rise"]


def theory(knobs):
    """Buoyancy below the risen level."""
    return _held(knobs["kind"], *_true(knobs))


def naive(knobs):
    """The force at 0.2 m in proportion; the buoyancy per depth at the start."""
    strengths, size, _ = _true(knobs)
    edge_force = float((_columns(knobs["kind"], [DEEPEST], size) @ np.asarray(strengths)).item())
    return {"in proportion": edge_force * ASKED / DEEPEST, "as at the start": knobs["k"] * ASKED}


def measure(engine, knobs):
    """The engine's float, held by a stiff hand at the asked place."""
    hand, goal, down = 100 * knobs["k"], ASKED, 0.0
    free = engine.changed({"joint[device_joint].damping": 1e9, "joint[object_2_joint].stiffness": hand})
    while abs(down - ASKED) > 1e-6:
        goal += ASKED - down if down else 0.0
        free.push(FLOAT, force=np.array([0.0, 0.0, -hand * goal]))
        free.step(free.whole_steps(2.0))
        down = -float(free.pose(FLOAT).position[2])
    return hand * (goal - down)
