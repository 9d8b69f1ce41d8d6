"""Scene 109: push against three springs, two and one; find each law from the sums, and add the stretches in a row."""

from itertools import permutations

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.loads import looks
from scenes.protocol import answer, call

ROW_M, CATCH_M, FAR_M = 0.6, 0.1, 1e6
HOOKS = ("object_2", "object_3", "object_4")
SORTS = ("even", "cubic", "slack", "weaker")
WAIT_S = 6.0
FIRST_N = 0.3
SIGMA = 5e-5
"""Standard deviation of a place that is read, m."""
TURNS = 6
"""Iterations of a stage."""
CHANGED_M, WEAKEST, END_M = 0.068, 2.9, 0.094
"""Place beyond which no law changes, greatest ratio of stiffnesses, and place up to which the carriage is pushed."""
EDGES = np.linspace(0.043, 0.067, 9)
STATED = {"cubic": [(0.25, 0.8)], "slack": [(0.04, 0.068)], "weaker": [(1.8, 3.0), (0.04, 0.068)]}
"""Ranges by the prompt: share of the third power in the pull at the catch; place of the change; ratio and place."""


def _pull(sort, x, stiffness, other, edge):
    """Pull of a spring: stiffness, second number (cubic part, or change of stiffness) and place of a change."""
    if sort == "even":
        return stiffness * x
    if sort == "cubic":
        return stiffness * x + other * x**3
    beyond = np.maximum(x - edge, 0.0)
    return other * beyond if sort == "slack" else stiffness * x - other * beyond


def _columns(sort, x, edge):
    """What the pull is linear in, for a place of the change."""
    beyond = np.maximum(x - edge, 0.0)
    return {"even": [x], "cubic": [x, x**3], "slack": [beyond], "weaker": [x, -beyond]}[sort]


def _row(laws):
    """Force at which the stretches of all springs add up to that of the row."""

    def stretch(law, force):
        def missing(x):
            return _pull(*law[:1], x, *law[1:]) - force

        return brentq(missing, 0.0, FAR_M, maxiter=500) if missing(FAR_M) > 0 else FAR_M

    def beyond(force):
        return sum(stretch(law, force) for law in laws) - ROW_M

    weakest, strongest = 1e-4, 1e5
    if beyond(weakest) > 0:
        return weakest
    return brentq(beyond, weakest, strongest) if beyond(strongest) > 0 else strongest


def _fitted(rows, sorts):
    """Misfit, and the laws of the springs at the hooks, if they are of these sorts."""
    x, force, there = rows[:, 0], rows[:, 1], rows[:, 2:]
    order = np.argsort(x)
    slope = np.full(len(x), force.max() / x.max())
    for stage in set(map(tuple, there)):
        own = [row for row in order if tuple(there[row]) == stage]
        slope[own] = np.gradient(force[own], x[own] + 1e-6 * np.arange(len(own))) if len(own) > 2 else slope[own]
    size = np.maximum(abs(slope), 0.05 * force.max() / x.max()) * SIGMA + 3e-4 * force

    def solved(edges):
        table = [
            column * there[:, hook]
            for hook, sort in enumerate(sorts)
            for column in _columns(sort, x, edges.get(sort, 0.0))
        ]
        table = np.column_stack(table) / size[:, None]
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, force / size, rcond=None)[0] / scale
        return table @ found - force / size, found

    bends = [sort for sort in sorts if sort in {"slack", "weaker"}]
    grid = np.array(np.meshgrid(*[EDGES] * len(bends))).reshape(len(bends), -1).T if bends else np.zeros((1, 0))
    start = min(grid, key=lambda edges: float((solved(dict(zip(bends, edges, strict=True)))[0] ** 2).sum()))
    if bends:
        start = least_squares(
            lambda edges: solved(dict(zip(bends, edges, strict=True)))[0], start, bounds=(0.035, 0.075), diff_step=1e-4
        ).x
    edges = dict(zip(bends, map(float, start), strict=True))
    misfit, found = solved(edges)
    laws, cost, left = [], float((misfit**2).sum()), list(map(float, found))
    for sort in sorts:
        first = left.pop(0) if sort != "slack" else 0.0
        other = left.pop(0) if sort != "even" else 0.0
        if (
            (sort != "slack" and first <= 0)
            or (sort != "even" and other <= 0)
            or (sort == "weaker" and not 0.3 * first < other < first)
        ):
            cost += 1e4
            first, other = (
                max(first, 0.1),
                float(np.clip(other, 0.0, 0.9 * max(first, 0.1) if sort == "weaker" else 1e9)),
            )
        laws.append((sort, first, max(other, 0.1) if sort == "slack" else other, edges.get(sort, 0.0)))
    return cost, laws


def _law(sort, constants):
    """The law of the logarithm of a stiffness and of what the prompt bounds."""
    k, *more = float(np.exp(constants[0])), *map(float, constants[1:])
    if sort == "cubic":
        return sort, k, k * more[0] / (1 - more[0]) / CATCH_M**2, 0.0
    if sort == "slack":
        return sort, 0.0, k, more[0]
    return (sort, k, k * (1 - 1 / more[0]), more[1]) if sort == "weaker" else (sort, k, 0.0, 0.0)


def _constants(sort, first, other, edge):
    """The constants of a law."""
    known = {
        "even": [first],
        "cubic": [first, 1 / (1 + first / CATCH_M**2 / max(other, 1e-9))],
        "slack": [other, edge],
        "weaker": [first, 1 / max(1 - other / max(first, 1e-3), 0.1), edge],
    }
    return [np.log(max(known[sort][0], 1e-3)), *known[sort][1:]]


def _weighed(rows, sorts):
    """Springs of these sorts, fitted within what the prompt states."""
    x, force, there = rows[:, 0], rows[:, 1], rows[:, 2:].T
    starts = [_constants(*law) for law in _fitted(rows, sorts)[1]]
    ends = np.cumsum([len(start) for start in starts])[:-1]

    def laws(constants):
        return [_law(sort, own) for sort, own in zip(sorts, np.split(constants, ends), strict=True)]

    def misfits(constants):
        low, at, high = (
            sum(on * _pull(law[0], x + shift, *law[1:]) for on, law in zip(there, laws(constants), strict=True))
            for shift in (-1e-4, 0.0, 1e-4)
        )
        return (at - force) / (SIGMA * (high - low) / 2e-4 + 1e-4 * force)

    ranges = [
        span
        for sort, start in zip(sorts, starts, strict=True)
        for span in ((start[0] - 1, start[0] + 1), *STATED.get(sort, []))
    ]
    low, high = np.array(ranges).T
    begin = np.clip(np.concatenate(starts), low, high)
    best = least_squares(misfits, begin, bounds=(low, high), x_scale=high - low, max_nfev=60).x
    return member(misfits, lambda constants: _row(laws(constants)), best, ranges)


def rivals(readings):
    """Springs of any three sorts, fitted."""
    rows = _rows(readings)
    return {", ".join(sorts): _weighed(rows, sorts) for sorts in permutations(SORTS, 3)}


def _rows(exchanges):
    """Rows of place, force, and which hooks are there."""
    rows, force, there = [], 0.0, dict.fromkeys(HOOKS, 1.0)
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "delete_objects":
            there[asked.arguments["object_id"]] = 0.0
        elif asked.tool == "get_position" and 5e-4 < reading["position"][0] < CATCH_M and force > 0:
            rows.append((reading["position"][0], force, *there.values()))
    return np.array(rows)


def _best(rows):
    """The force for the row by the sorts that fit best."""
    found = [_fitted(rows, sorts) for sorts in permutations(SORTS, 3)]
    return _row(min(found, key=lambda fit: fit[0])[1])


def fit(readings, structure):
    """The force for the row by springs of these sorts."""
    return _row(_fitted(_rows(readings), tuple(structure.split(", ")))[1])


def _push(force):
    newtons = round(float(force), 4)
    return [call("apply_force", object_id="object_1", force_vector=[newtons, 0, 0]), *looks("object_1", [WAIT_S])]


def solve(task):
    """Push step by step up to the catch, with three springs, two and one; each force follows from the places before."""
    exchanges, first = [], FIRST_N
    for gone in (None, "object_4", "object_3"):
        calls = []
        if gone:
            calls = [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=WAIT_S)]
            calls.append(call("delete_objects", object_id=gone))
        points = [(0.0, 0.0)]
        calls += _push(first)
        for turn in range(TURNS):
            readings = yield calls
            exchanges += zip(calls, readings, strict=True)
            forces = [asked.arguments["force_vector"][0] for asked in calls if asked.tool == "apply_force"]
            places = [reading["position"][0] for reading in readings if "position" in reading]
            points += zip(places, forces[-len(places) :], strict=True)
            x, force = points[-1]
            if x > END_M - 0.004 or turn == TURNS - 1:
                break
            slope = (force - points[-2][1]) / max(x - points[-2][0], 2e-4)
            far = (END_M if x > CHANGED_M else x + (END_M - x) / WEAKEST) if x > 0.02 else 0.036
            calls = [made for goal in ((x + far) / 2, far) for made in _push(force + slope * (goal - x))]
        first = 0.1 * force
    yield [answer(_best(_rows(exchanges)))]


def batch(task):
    """Six forces in even ratios with three springs, two and one, and the best fit."""
    calls = []
    for gone, most in ((None, 40.0), ("object_4", 25.0), ("object_3", 12.0)):
        if gone:
            calls.append(call("delete_objects", object_id=gone))
        for number in range(6):
            calls += _push(most * 40 ** (number / 5 - 1))
    readings = yield calls
    rows = _rows(list(zip(calls, readings, strict=True)))
    yield [answer(_best(rows) if len(rows) > 2 else 10.0)]


def stage(task):
    """Push three springs nearly to the catch, and carry the force over in proportion to the stretch."""
    force, readings = FIRST_N, (yield _push(FIRST_N))
    for _ in range(12):
        if readings[-1]["position"][0] > 0.05:
            break
        force *= 1.5
        readings = yield _push(force)
    yield [answer(force / max(readings[-1]["position"][0], 1e-3) * ROW_M)]


def structure(knobs):
    """Sorts of the springs at the three hooks."""
    return ", ".join(knobs["sorts"][(hook + int(knobs["shift"])) % 3] for hook in range(3))


def _laws(knobs):
    scale = knobs["scale"]
    known = {
        "even": (scale * knobs["even"], 0.0, 0.0),
        "cubic": (scale * knobs["cubic"], scale * knobs["cubic"] / knobs["w"] ** 2, 0.0),
        "slack": (0.0, scale * knobs["slack"], knobs["s1"]),
        "weaker": (scale * knobs["weaker"], scale * knobs["weaker"] * (1 - 1 / knobs["ratio"]), knobs["s2"]),
    }
    return [(sort, *known[sort]) for sort in knobs["sorts"][:3]]


def naive(knobs):
    """The first stiffnesses of those springs that are not slack at first."""
    rigid = [law[1] for law in _laws(knobs) if law[0] != "slack"]
    return {"first stiffnesses": ROW_M / sum(1 / k for k in rigid)}


def theory(knobs):
    """Equal pulls, stretches that add up."""
    return _row(_laws(knobs))


def measure(engine, knobs):
    """The engine's pull of each spring, alone, at the stretch that the row gives it."""
    force = theory(knobs)
    stretches = []
    for hook in HOOKS:
        alone = engine.changed({"joint[object_1_joint].range": (-1e-3, 1e3), "joint[trigger_joint].damping": 1e9})
        for other in HOOKS:
            if other != hook:
                alone.remove(other)
        alone.push("object_1", force=np.array([force, 0.0, 0.0]))
        alone.step(alone.whole_steps(20.0))
        stretches.append(float(alone.pose("object_1").position[0]))
    return float(force * ROW_M / sum(stretches))
