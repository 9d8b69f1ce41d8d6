"""Scene 48: push the head step by step below the speed of the device, find the springs, and carry their law on."""

import numpy as np

from scenes.protocol import answer, call

FOOT, HEAD = "object_1", "object_2"
TOP, OUT, ROD = 0.6, 0.8, 1.0
ASKED, FASTEST, DEEPEST = 0.45, 0.045, 0.12
SIGMA = 1.2e-4
"""Standard deviation of a way that is read, m."""
FIRST_N, LOOK_S, WAIT_S = 0.1, 0.06, 5.0
SINGLY, MOST, LAST = 6, 20, 0.114
"""Steps that are made one by one and watched, most steps, and the way that is enough."""
KINDS = {"even foot": 1, "stiff foot": 2, "late foot": 3, "even foot and head": 2}
"""How many numbers describe each kind of springs."""
EDGES = np.arange(0.02, 0.0701, 0.001)


def _columns(kind, down, edge):
    """Forces on the head for springs of unit strength."""
    high = TOP - np.asarray(down, dtype=float)
    foot = np.sqrt(ROD**2 - high**2)
    way, slope = foot - OUT, high / foot
    columns = [way * slope]
    if kind == "stiff foot":
        columns.append(way**3 * slope)
    elif kind == "late foot":
        columns.append(np.maximum(way - edge, 0.0) * slope)
    elif kind == "even foot and head":
        columns.append(TOP - high)
    return np.stack(columns, axis=-1)


def _held(kind, strengths, edge):
    """Force at the asked place."""
    return float((_columns(kind, [ASKED], edge) @ np.asarray(strengths)).item())


def _fitted(rows, kind):
    """Misfit in standard deviations, strengths, and the way from which a further spring acts."""
    forces, down = np.array(rows).T
    best = None
    for edge in EDGES if kind == "late foot" else (1.0,):
        table, ahead = _columns(kind, down, edge), _columns(kind, down + 1e-5, edge)
        slope = np.full(len(down), float(forces @ down / (down @ down)))
        for _ in range(4):
            error = SIGMA * slope
            strengths = np.linalg.lstsq(table / error[:, None], forces / error, rcond=None)[0]
            slope = np.maximum((ahead - table) @ strengths / 1e-5, 0.1 * np.max(slope))
        misfit = float((((table @ strengths - forces) / error) ** 2).sum()) + 1e4 * float(min(strengths) < 0)
        if best is None or misfit < best[0]:
            best = (misfit, strengths, edge)
    return best


def _best(rows):
    """The force by the springs that fit best, each number paid for."""
    found = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(KINDS, key=lambda kind: found[kind][0] + 5 * KINDS[kind])
    return _held(kind, *found[kind][1:])


def _rows_of(exchanges):
    """Forces and ways of the head wherever it was at rest within the range, until the springs are unhooked."""
    force, last, rows = 0.0, 0.0, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = -asked.arguments["force_vector"][2]
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position" and last > 1.0:
            down = TOP - reading["position"][2]
            if down > DEEPEST:
                break
            rows.append((force, down))
    return rows


def fit(readings, structure):
    """The force by springs of one kind."""
    return _held(structure, *_fitted(_rows_of(readings), structure)[1:])


def _push(force):
    return call("apply_force", object_id=HEAD, force_vector=[0, 0, -float(f"{force:.5g}")])


def _rest():
    return [call("step", duration=WAIT_S), call("get_position", object_id=HEAD)]


def solve(task):
    """Forces that grow step by step, first singly and watched, then two at a time."""
    yield [call("find_objects")]
    exchanges, force, more, number, way = [], 0.0, FIRST_N, 0, 0.0
    allowed, gained = np.inf, 0.0
    while number < MOST and way < LAST:
        before, calls, count = way, [], 1 if number < SINGLY or DEEPEST - way < 3.5 * gained else 2
        for _ in range(count):
            force += more
            look = [call("step", duration=LOOK_S), call("get_velocity", object_id=HEAD)] if number < SINGLY else []
            calls += [_push(force), *look, *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        way = _rows_of(exchanges)[-1][1]
        if number < SINGLY:
            allowed = 0.85 * FASTEST * more / max(-readings[-3]["velocity"][2], 0.0005)
        number += count
        gained = max((way - before) / count, 5e-4)
        more = min(8 * more, allowed, 0.75 * more * max(DEEPEST - way, 5e-4) / gained)
    yield [answer(_best(_rows_of(exchanges)))]


def stage(task):
    """Push with more and more force until the head goes through."""
    calls = [call("find_objects")]
    for number in range(14):
        calls += [_push(0.05 * 2.0**number), *_rest()]
    readings = yield calls
    ways = [reading["position"][2] for reading in readings if "position" in reading]
    through = next((number for number, height in enumerate(ways) if height < TOP - DEEPEST), 13)
    yield [answer(0.05 * 2.0**through)]


def batch(task):
    """Forces in even ratios over the whole range, and the same fit."""
    calls = [call("find_objects")]
    for number in range(19):
        calls += [_push(0.06 * 1.5**number), *_rest()]
    readings = yield calls
    rows = _rows_of(list(zip(calls, readings, strict=True)))
    yield [answer(_best(rows) if len(rows) > 2 else 10.0)]


def structure(knobs):
    """Which springs there are."""
    return knobs["kind"]


def _true(knobs):
    """Strengths of the springs, and the way from which a further one acts."""
    more = {"stiff foot": [knobs["k3"]], "late foot": [knobs["kq"]], "even foot and head": [knobs["kh"]]}
    return [knobs["k"], *more.get(knobs["kind"], [])], knobs["s"]


def theory(knobs):
    """Work of the push is work on the springs."""
    return _held(knobs["kind"], *_true(knobs))


def naive(knobs):
    """The force at the end of the laboratory's range; an even spring of the foot that needs the same force there."""
    strengths, edge = _true(knobs)
    edge_force = (_columns(knobs["kind"], [DEEPEST], edge) @ np.array(strengths)).item()
    even = edge_force / _columns("even foot", [DEEPEST], 1.0).item()
    return {"force at 0.12 m": edge_force, "even spring": _held("even foot", [even], 1.0)}


def measure(engine, knobs):
    """The engine's head, held by a stiff hand at the asked place."""
    hand, goal, down = 100 * knobs["k"], ASKED, 0.0
    free = engine.changed({"joint[device_joint].damping": 1e9, "joint[object_2_joint].stiffness": hand})
    while abs(down - ASKED) > 1e-6:
        goal += ASKED - down if down else 0.0
        free.push(HEAD, force=np.array([0.0, 0.0, -hand * goal]))
        free.step(free.whole_steps(2.0))
        down = TOP - float(free.pose(HEAD).position[2])
    return hand * (goal - down)
