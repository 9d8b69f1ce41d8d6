"""Scene 104: load one pan, the other, and both, up to just above the catches; find what acts between them."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, ball, hung, joined
from scenes.protocol import answer, call
from scenes.springs import best_edge, solved

TOP, CATCH = 2.0, 0.3
FAR, NEAR = 0.9, 0.1
KINDS = ("first", "second", "cord", "lever")
PANS = {"object_1": -0.3, "object_2": 0.3}
"""Pans, and where they stand along x, m."""
RADIUS = 0.1
WAIT_S = 5.0
FIRST_KG, GROWTH, SEEN = 0.004, 8.0, 0.006
SIGMA = 5e-5
"""Standard deviation of a place that is read, m."""
STEEP = (0.8, 5.0)
"""Stiffness of what is between over that of the first spring, by the prompt, and at most."""
ALONE = (0.1, 0.2, 0.24, 0.266, 0.29)
ALSO = (0.16, 0.225, 0.258, 0.289)
BOTH = (0.18, 0.215, 0.252, 0.288)
"""Ways that are aimed at, m: the first pan alone, the second alone, both together."""


def _edges(kind):
    """Where what is between begins to act, by the prompt."""
    return (0.36, 0.5) if kind == "lever" else (0.19, 0.27)


def _between(kind, edge, first, second):
    """Forces, over the stiffness of what is between, that the pans need besides."""
    if kind == "lever":
        push = np.maximum(first + second - edge, 0.0)
        return push, push
    pull = np.zeros_like(first + second)
    if kind in {"first", "cord"}:
        pull = pull + np.maximum(first - second - edge, 0.0)
    if kind in {"second", "cord"}:
        pull = pull - np.maximum(second - first - edge, 0.0)
    return pull, -pull


def _needed(kind, law, first, second):
    """Forces that hold the pans at ways, by a law: two stiffnesses, that of what is between, and where it begins."""
    k1, k2, joint, edge = law
    more = _between(kind, edge, np.float64(first), np.float64(second))
    return [float(k1 * first + joint * more[0]), float(k2 * second + joint * more[1])]


def _asked(kind, law):
    """Both asked forces."""
    return [_needed(kind, law, FAR, NEAR)[0], _needed(kind, law, NEAR, FAR)[1]]


def _drawn(knobs):
    k1 = knobs["k1"]
    edge = knobs["length" if knobs["kind"] == "lever" else "height"]
    return k1, k1 * knobs["other"], k1 * knobs["joint"], edge


def _fitted(rows, kind):
    """Misfit and law if a kind of thing is between the pans."""
    first, second, *pushes = rows.T
    size = np.concatenate([1e-3 * push + SIGMA * max(float(push.max()), 1e-6) / 0.3 * 3 for push in pushes])
    none = np.zeros_like(first)

    def at(edge):
        columns = [[first, none], [none, second], _between(kind, edge, first, second)]
        return solved([np.concatenate(column) for column in columns], np.concatenate(pushes), size)

    low, high = _edges(kind)
    edge = best_edge(at, np.linspace(low, high, 25), (low - 0.01, high + 0.01))
    misfit, found = at(edge)
    return float((misfit**2).sum()) + 1e3 * (found[2] < 0), (*map(float, found), edge)


def _ways(kind, law, pushes):
    """Where the pans rest under forces, in a row for each."""
    k1, k2, joint, edge = law
    first, second = pushes[0] / k1, pushes[1] / k2  # without what is between
    bare = _between(kind, edge, first, second)
    pulls = [joint * part / (1 + joint * (1 / k1 + 1 / k2)) for part in bare]
    return np.array([first - pulls[0] / k1, second - pulls[1] / k2])


def _weighed(rows, kind):
    """A kind of thing between the pans, fitted to their ways."""
    ways, pushes = rows.T[:2], rows.T[2:]

    def law(constants):
        k1, k2, steep = np.exp(constants[:3])
        return k1, k2, steep * k1, constants[3]

    def misfits(constants):
        return ((_ways(kind, law(constants), pushes) - ways) / SIGMA).ravel()

    k1, k2, joint, edge = np.maximum(_fitted(rows, kind)[1], 1e-6)
    logs = np.log([k1, k2])
    ranges = [*((value - 0.5, value + 0.5) for value in logs), tuple(np.log(STEEP)), _edges(kind)]
    low, high = np.array(ranges).T
    start = np.clip([*logs, np.log(joint / k1), edge], low + 1e-6, high - 1e-6)
    best = least_squares(misfits, start, bounds=(low, high), x_scale=high - low).x
    return member(misfits, lambda constants: _asked(kind, law(constants)), best, ranges)


def _rows(exchanges):
    """Rows of the ways of both pans and the loads on both, until a catch holds one."""
    rows, ways = [], {}
    for asked, reading, load in hung(exchanges):
        if asked.tool == "get_position":
            ways[asked.arguments["object_id"]] = TOP - reading["position"][2]
            if max(ways.values()) > CATCH + 0.005:
                break
            if asked.arguments["object_id"] == "object_2":
                pushes = [GRAVITY * load[pan] for pan in PANS]
                rows.append((ways["object_1"], ways["object_2"], *(push if push > 1e-6 else 0.0 for push in pushes)))
    return np.array(rows or [(0.1, 0.1, 1.0, 1.0)])


def _best(rows):
    """Both forces by what fits best."""
    fits = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(KINDS, key=lambda kind: fits[kind][0])
    return _asked(kind, fits[kind][1])


def fit(readings, structure):
    """Both forces with one thing between the pans."""
    return _asked(structure, _fitted(_rows(readings), structure)[1])


def rivals(readings):
    """Each thing that may be between the pans, fitted."""
    rows = _rows(readings)
    return {kind: _weighed(rows, kind) for kind in KINDS}


class _Bench:
    """Names of the balls that lie on the pans."""

    def __init__(self):
        self.number, self.lying = dict.fromkeys(PANS, 0), {}

    def load(self, loads):
        """Calls that put one ball on each pan instead of the one before (0: none), wait and read both places."""
        calls = []
        for pan, kg in zip(PANS, loads, strict=True):
            old = self.lying.pop(pan, None)
            if kg > 0:
                name = f"b{pan[-1]}_{self.number[pan]}"
                self.number[pan] += 1
                where = [PANS[pan], 0.5 * (self.number[pan] % 2) - 0.25, TOP]
                calls += joined(ball(name, kg, where, RADIUS), pan)
                self.lying[pan] = name
            if old:
                calls.append(call("delete_objects", object_id=old))
        return [*calls, call("step", duration=WAIT_S), *(call("get_position", object_id=pan) for pan in PANS)]


def _farther(points, goal):
    """Load that brings a pan to a way, carried on from the last two points of (way, load)."""
    (a, before), (b, now) = points[-2:]
    return now + (now - before) / max(b - a, 1e-4) * (goal - b)


def solve(task):
    """Scale first; then the first pan alone, the second alone, and both, each load from the places before."""
    bench, seen, kg = _Bench(), [], FIRST_KG / GROWTH
    while not seen or _rows(seen)[-1, 0] < SEEN:
        kg *= GROWTH
        calls = bench.load([kg, 0])
        seen += zip(calls, (yield calls), strict=True)
    points = [(0.0, 0.0), (_rows(seen)[-1, 0], kg)]
    for goal in ALONE:
        if goal > points[-1][0] + 0.008:
            kg = _farther(points, goal)
            calls = bench.load([kg, 0])
            seen += zip(calls, (yield calls), strict=True)
            points.append((_rows(seen)[-1, 0], kg))
    soft_1 = points[2][0] / points[2][1]
    points, kg = [(0.0, 0.0)], 0.1 / soft_1
    calls = bench.load([0, kg])
    seen += zip(calls, (yield calls), strict=True)
    points.append((_rows(seen)[-1, 1], kg))
    soft_2 = points[1][0] / points[1][1]
    for goal in ALSO:
        if goal > points[-1][0] + 0.008:
            kg = _farther(points, goal)
            calls = bench.load([0, kg])
            seen += zip(calls, (yield calls), strict=True)
            points.append((_rows(seen)[-1, 1], kg))
    held, more = np.array([0.0, 0.0]), np.array([1 / soft_1, 1 / soft_2])
    for goal, last in zip(BOTH, (0.0, *BOTH), strict=False):
        # Each pan gets what its spring and, as far as seen, the lever take for the next bit of way.
        held = held + more * (goal - last)
        calls = bench.load(list(held))
        seen += zip(calls, (yield calls), strict=True)
        lacking = goal - _rows(seen)[-1, :2]
        held = held + np.array([1 / soft_1, 1 / soft_2]) * np.maximum(lacking, 0.0)
    yield [answer(_best(_rows(seen)))]


def batch(task):
    """Fixed loads in even ratios on one pan, the other, and both, and the best fit."""
    bench, calls = _Bench(), []
    for rung in range(4):
        kg = 0.06 * 3.5**rung
        for loads in ([kg, 0], [0, kg], [kg, kg])[: 3 if rung % 2 else 2]:
            calls += bench.load(loads)
    calls = calls[:60]
    yield [answer(_best(_rows(list(zip(calls, (yield calls), strict=True)))))]


def stage(task):
    """Load the first pan at once with much."""
    readings = yield _Bench().load([30.0, 0])
    force = 30.0 * GRAVITY * FAR / max(TOP - readings[-2]["position"][2], 0.05)
    yield [answer([force, force])]


def predict(structure, knobs):
    """Springs and what is between, at the asked ways."""
    return _asked(structure, _drawn(knobs))


def naive(knobs):
    """The springs alone."""
    k1, k2, _, edge = _drawn(knobs)
    return {"springs alone": _asked(knobs["kind"], (k1, k2, 0.0, edge))}


def _free(engine):
    """The engine's pans without the catches."""
    changes = {}
    for number in (1, 2):
        changes |= {f"joint[guide{number}].range": (-5.0, 5.0), f"body[trigger{number}]/inertial.mass": 1e12}
    return engine.changed(changes)


def measure(engine, knobs):
    """Forces that hold the engine's pans at the asked ways, without the catches."""
    forces = []
    for which, ways in enumerate(((FAR, NEAR), (NEAR, FAR))):
        free, held = _free(engine), np.zeros(2)
        k = np.array([knobs["k1"], knobs["k1"] * knobs["other"]])
        for _ in range(free.whole_steps(25.0)):
            lacking = np.array([way - TOP + free.pose(pan).position[2] for pan, way in zip(PANS, ways, strict=True)])
            held = held + 0.01 * k * lacking
            for pan, force in zip(PANS, held + k * lacking, strict=True):
                free.push(pan, force=np.array([0.0, 0.0, -force]))
            free.step(1)
        forces.append(float(held[which]))
    return forces


def settles(engine, knobs, off):
    """Where the pans come to rest under the asked forces, after other forces have held them off the asked ways."""
    left = []
    for ways in ((FAR, NEAR), (NEAR, FAR)):
        free = _free(engine)
        for share in (1 + off, 1.0):
            forces = _needed(knobs["kind"], _drawn(knobs), *(share * way for way in ways))
            for pan, force in zip(PANS, forces, strict=True):
                free.push(pan, force=np.array([0.0, 0.0, -force]))
            free.step(free.whole_steps(10.0))
        left += [(TOP - free.pose(pan).position[2]) / way - 1 for pan, way in zip(PANS, ways, strict=True)]
    return float(max(left, key=abs))
