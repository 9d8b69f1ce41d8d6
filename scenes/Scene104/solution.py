"""Scene 104: load one pan, the other, and both, up to just above the catches; find what acts between them."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, TOP, CATCH = 9.81, 2.0, 0.3
FAR, NEAR = 0.9, 0.1
KINDS = ("first", "second", "cord", "lever")
PANS = {"object_1": -0.3, "object_2": 0.3}
"""Pans, and where they stand along x, m."""
RADIUS = 0.1
WAIT_S = 5.0
FIRST_KG, GROWTH, SEEN = 0.004, 8.0, 0.006
SIGMA = 5e-5
"""Standard deviation of a place that is read, m."""
ALONE = (0.1, 0.2, 0.24, 0.266, 0.29)
ALSO = (0.16, 0.225, 0.258, 0.289)
BOTH = (0.18, 0.215, 0.252, 0.288)
"""Ways that are aimed at, m: the first pan alone, the second alone, both together."""


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


def _fitted(rows, kind):
    """Misfit, and both asked forces, if a kind of thing is between the pans."""
    first, second, push_1, push_2 = rows.T
    sizes = [1e-3 * push + SIGMA * max(float(push.max()), 1e-6) / 0.3 * 3 for push in (push_1, push_2)]

    def solved(edge):
        more = _between(kind, edge, first, second)
        none = np.zeros_like(first)
        tables = [np.column_stack([first, none, more[0]]), np.column_stack([none, second, more[1]])]
        table = np.vstack([table / size[:, None] for table, size in zip(tables, sizes, strict=True)])
        wanted = np.concatenate([push_1 / sizes[0], push_2 / sizes[1]])
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, wanted, rcond=None)[0] / scale
        return table @ found - wanted, found

    low, high = (0.36, 0.5) if kind == "lever" else (0.19, 0.27)
    edge = min(np.linspace(low, high, 25), key=lambda edge: float((solved(edge)[0] ** 2).sum()))
    edge = float(
        least_squares(lambda at: solved(at[0])[0], [edge], bounds=(low - 0.01, high + 0.01), diff_step=1e-4).x[0]
    )
    misfit, (k1, k2, joint) = solved(edge)
    far, near = np.float64(FAR), np.float64(NEAR)
    forces = [
        k1 * FAR + joint * _between(kind, edge, far, near)[0],
        k2 * FAR + joint * _between(kind, edge, near, far)[1],
    ]
    return float((misfit**2).sum()) + 1e3 * (joint < 0), [float(force) for force in forces]


def _rows(exchanges):
    """Rows of the ways of both pans and the loads on both, until a catch holds one."""
    rows, made, joined, load, ways = [], {}, {}, dict.fromkeys(PANS, 0.0), {}
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            ball, pan = asked.arguments["object1_id"], asked.arguments["object2_id"]
            joined[ball] = pan
            load[pan] += made[ball]
        elif asked.tool == "delete_objects":
            ball = asked.arguments["object_id"]
            load[joined[ball]] -= made[ball]
        elif asked.tool == "get_position":
            ways[asked.arguments["object_id"]] = TOP - reading["position"][2]
            if max(ways.values()) > CATCH + 0.005:
                break
            if asked.arguments["object_id"] == "object_2":
                pushes = [max(GRAVITY * load[pan], 0.0) for pan in PANS]
                rows.append((ways["object_1"], ways["object_2"], *(push if push > 1e-6 else 0.0 for push in pushes)))
    return np.array(rows or [(0.1, 0.1, 1.0, 1.0)])


def _best(rows):
    """Both forces by what fits best; a cord must be clearly better than a hook."""
    fits = {kind: _fitted(rows, kind) for kind in KINDS}
    return fits[min(KINDS, key=lambda kind: fits[kind][0])][1]


def fit(readings, structure):
    """Both forces with one thing between the pans."""
    return _fitted(_rows(readings), structure)[1]


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
                calls.append(
                    call(
                        "create_objects",
                        name=name,
                        pos=[PANS[pan], 0.5 * (self.number[pan] % 2) - 0.25, TOP],
                        density=kg / (4 / 3 * pi * RADIUS**3),
                        rgba=[1, 0, 0, 1],
                        radius=RADIUS,
                    )
                )
                calls.append(call("attach_objects", object1_id=name, object2_id=pan))
                self.lying[pan] = name
            if old:
                calls.append(call("delete_objects", object_id=old))
        looks = [call("get_position", object_id=pan) for pan in PANS]
        return [*calls, call("step", duration=WAIT_S), *looks]


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


def structure(knobs):
    """What is between the pans."""
    return knobs["kind"]


def _forces(knobs, joint):
    kind, k1 = knobs["kind"], knobs["k1"]
    edge = knobs["length" if kind == "lever" else "height"]
    return [
        float(k1 * FAR + joint * k1 * _between(kind, edge, np.float64(FAR), np.float64(NEAR))[0]),
        float(k1 * knobs["other"] * FAR + joint * k1 * _between(kind, edge, np.float64(NEAR), np.float64(FAR))[1]),
    ]


def naive(knobs):
    """The springs alone."""
    return {"springs alone": _forces(knobs, 0.0)}


def theory(knobs):
    """Springs and what is between, at the asked ways."""
    return _forces(knobs, knobs["joint"])


def measure(engine, knobs):
    """Forces that hold the engine's pans at the asked ways, without the catches."""
    changes = {}
    for number in (1, 2):
        changes |= {f"joint[guide{number}].range": (-5.0, 5.0), f"body[trigger{number}]/inertial.mass": 1e12}
    forces = []
    for which, ways in enumerate(((FAR, NEAR), (NEAR, FAR))):
        free, held = engine.changed(changes), np.zeros(2)
        k = np.array([knobs["k1"], knobs["k1"] * knobs["other"]])
        for _ in range(free.whole_steps(25.0)):
            lacking = np.array([way - TOP + free.pose(pan).position[2] for pan, way in zip(PANS, ways, strict=True)])
            held = held + 0.01 * k * lacking
            for pan, force in zip(PANS, held + k * lacking, strict=True):
                free.push(pan, force=np.array([0.0, 0.0, -force]))
            free.step(1)
        forces.append(float(held[which]))
    return forces
