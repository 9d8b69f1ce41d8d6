"""Scene 39: swings pushed, pumped and free give a balance of momentum, whose terms say what takes the energy."""

from itertools import combinations, pairwise
from math import exp, pi, sqrt

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from scenes.protocol import answer, call

CARRIAGE = "object_1"
MASS, LOADED = 1.0, 16.0
OUT_M, SWINGS = 1.0, 5
LIMIT_N = 0.78
FIRST_S = 0.1
PUMPS, HALVES = 3, 5
PAUSE_S = 9.0
TIMES_S = np.geomspace(0.03, 12, 28)
"""Relaxation times that are tried."""
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
PENALTY = 8.0
SUBSTEP_S, LEAST = 0.03, 1e-3
STRUCTURES = ["".join(kinds) for count in (1, 2) for kinds in combinations("VCMQ", count)]
"""Kinds of loss, alone and in pairs: in proportion to the speed, its cube, a dashpot behind a spring, the square."""


def _readings(exchanges):
    """Stretches of successive readings, each an array of rows: time, place, velocity, push until then."""
    push, stretches, unread, row = 0.0, [[]], False, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            push = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            if unread:  # the place in between is not known
                stretches.append([])
            unread = True
        elif asked.tool == "get_position":
            row = [reading["sim_time"], reading["position"][0]]
        elif asked.tool == "get_velocity":
            stretches[-1].append([*row, reading["velocity"][0], push])
            unread = False
    return [np.array(rows) for rows in stretches if len(rows) > 1]


def _path(begin, end):
    """Times, weights, places and velocities at the points of an interval, by the cubic through both ends."""
    span = end[0] - begin[0]
    s = (POINTS + 1) / 2
    x0, v0, x1, v1 = begin[1], begin[2] * span, end[1], end[2] * span
    a, b = 2 * (x0 - x1) + v0 + v1, 3 * (x1 - x0) - 2 * v0 - v1
    return (
        begin[0] + s * span,
        WEIGHTS * span / 2,
        x0 + s * (v0 + s * (b + s * a)),
        (v0 + s * (2 * b + 3 * s * a)) / span,
    )


def _balance(stretches):
    """What the spring, V, Q and D must explain in each interval: columns, the momentum, and the paths for M."""
    columns, momentum, paths = [], [], []
    for rows in stretches:
        way = []
        for begin, end in pairwise(rows):
            time, weight, x, v = _path(begin, end)
            columns.append([weight @ x, weight @ v, weight @ (v * abs(v)), weight @ v**3])
            momentum.append(end[3] * (end[0] - begin[0]) - MASS * (end[2] - begin[2]))
            way.append((time, weight, x))
        paths.append(way)
    return np.array(columns), np.array(momentum), paths


def _branch(paths, tau):
    """Columns of M: the stretch of its spring, and for each stretch of readings what remains of its start."""
    total = sum(map(len, paths))
    columns, number = np.zeros((total, 1 + len(paths))), 0
    for stretch, way in enumerate(paths):
        start, dash, before, clock = way[0][0][0], 0.0, None, way[0][0][0]
        for time, weight, x in way:
            lag = np.empty(len(time))
            for index, (moment, place) in enumerate(zip(time, x, strict=True)):
                if before is None:
                    dash, before = place, place
                keep = exp(-(moment - clock) / tau)
                dash = dash * keep + (place + before) / 2 * (1 - keep)
                lag[index], before, clock = place - dash, place, moment
            columns[number, 0] = weight @ lag
            columns[number, 1 + stretch] = weight @ np.exp(-(time - start) / tau)
            number += 1
    return columns


def _terms(stretches, kinds):
    """The best k, c, q, c3, k2, tau with only these kinds of loss, and a score: low for few and small misfits."""
    columns, momentum, paths = _balance(stretches)
    used = [0] + ["?VQC".index(kind) for kind in kinds if kind != "M"]
    best = None
    for tau in TIMES_S if "M" in kinds else (1.0,):
        table = columns[:, used]
        if "M" in kinds:
            table = np.hstack([table, _branch(paths, tau)])
        found, *_ = np.linalg.lstsq(table, momentum, rcond=None)
        misfit = float(np.sum((table @ found - momentum) ** 2))
        if best is None or misfit < best[0]:
            best = misfit, found, tau
    misfit, found, tau = best
    values = dict.fromkeys("?VQC", 0.0) | dict(zip(("?VQC"[index] for index in used), found, strict=False))
    k2 = found[len(used)] if "M" in kinds else 0.0
    score = len(momentum) * np.log(misfit) + PENALTY * (len(kinds) + ("M" in kinds))
    if min(*found[: len(used)], k2) < 0:
        score += 1000
    return score, (*values.values(), k2, tau)


def _events(exchanges):
    """All steps, each with the push during it and what was read after it, or None: (seconds, push, reading)."""
    push, events = 0.0, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            push = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            events.append([asked.arguments["duration"], push, None])
        elif asked.tool == "get_position":
            place = reading["position"][0]
        elif asked.tool == "get_velocity":
            events[-1][2] = (place, reading["velocity"][0])
    return events


def _swing(events, terms):
    """What would be read with these terms, an array (6, n) of n cases: shape (readings, 2, n)."""
    k, c, q, c3, k2, tau = terms
    state, found = np.zeros((3, terms.shape[1])), []

    def slope(s, push):
        x, v, dash = s
        force = push - k * x - c * v - q * v * abs(v) - c3 * v**3 - k2 * (x - dash)
        return np.array([v, force / MASS, (x - dash) / tau])

    for seconds, push, read in events:
        count = int(np.ceil(seconds / SUBSTEP_S))
        h = seconds / count
        for _ in range(count):
            a = slope(state, push)
            b = slope(state + h / 2 * a, push)
            d = slope(state + h / 2 * b, push)
            state = state + h / 6 * (a + 2 * b + 2 * d + slope(state + h * d, push))
        if read:
            found.append(state[:2])
    return np.array(found)


def _refined(events, kinds, start):
    """The terms fitted to all that was read since the start, and a score: low for few and small misfits."""
    read = np.array([reading for *_, reading in events if reading])
    free = [0] + [index for kind, index in (("V", 1), ("Q", 2), ("C", 3), ("M", 4), ("M", 5)) if kind in kinds]

    def terms(values):
        all_terms = np.zeros((6, *values.shape[1:])) + (1e-9 if values.ndim == 1 else np.full((1, 1), 1e-9))
        all_terms[5] = 1.0
        all_terms[free] = np.exp(values)
        return all_terms

    def misfit(values):
        return (_swing(events, terms(values[:, None]))[:, :, 0] - read).ravel()

    def jacobian(values):
        cases = np.hstack([values[:, None], values[:, None] + 1e-4 * np.eye(len(values))])
        swings = _swing(events, terms(cases)).reshape(-1, cases.shape[1])
        return (swings[:, 1:] - swings[:, :1]) / 1e-4

    begin = np.log(np.maximum(np.array(start)[free], LEAST))
    found = least_squares(misfit, begin, jac=jacobian, x_scale=0.1, max_nfev=25)
    return read.size * np.log(2 * found.cost) + PENALTY * len(free), terms(found.x)


def _best(exchanges, structures=STRUCTURES):
    """The best terms of these kinds of loss: the likeliest by the balance, refined."""
    stretches, events = _readings(exchanges), _events(exchanges)
    rough = sorted(((*_terms(stretches, kinds), kinds) for kinds in structures), key=lambda fit: fit[0])
    return min((_refined(events, kinds, start) for _, start, kinds in rough[:3]), key=lambda fit: fit[0])[1]


def _turns(terms, mass, push, start, count):
    """Times and places of the next turns from a state (place, velocity, place of the dashpot)."""
    k, c, q, c3, k2, tau = terms
    state, clock, turns = list(start), 0.0, []
    for _ in range(count):
        drive = push(turns) if callable(push) else push
        pull = drive - k * state[0] - k2 * (state[0] - state[2])
        way = np.sign(state[1]) if abs(state[1]) > 1e-9 else np.sign(pull)

        def slope(_, s, drive=drive):
            force = drive - k * s[0] - c * s[1] - q * s[1] * abs(s[1]) - c3 * s[1] ** 3 - k2 * (s[0] - s[2])
            return [s[1], force / mass, (s[0] - s[2]) / tau]

        def turned(_, s, way=way):
            return way * s[1]

        turned.terminal, turned.direction = True, -1
        run = solve_ivp(slope, (0, 50), state, events=turned, rtol=1e-7, atol=1e-9)
        state, clock = [run.y[0, -1], 0.0, run.y[2, -1]], clock + run.t[-1]
        turns.append((clock, state[0]))
    return turns


def _prediction(terms):
    """Where the loaded carriage turns at the end of its fifth swing."""
    turns = _turns(terms, LOADED, 0.0, (OUT_M, 0.0, OUT_M), 2 * SWINGS)
    return float(turns[-1][1])


def fit(readings, structure):
    """The place by the kinds of loss of a structure."""
    return _prediction(_best(readings, [structure]))


def _look(seconds):
    seconds = max(0.005 * round(seconds / 0.005), 0.005)
    return [
        call("step", duration=seconds),
        call("get_position", object_id=CARRIAGE),
        call("get_velocity", object_id=CARRIAGE),
    ]


def _push(force):
    return call("apply_force", object_id=CARRIAGE, force_vector=[force, 0.0, 0.0])


def _pump(terms, place, velocity):
    """Push with the motion over the next half swings; a turn is when to push the other way."""
    way = 1.0 if velocity >= 0 else -1.0
    turns = _turns(terms, MASS, lambda done: LIMIT_N * way * (-1) ** len(done), (place, velocity, 0.0), HALVES)
    calls, before = [], 0.0
    for number, (moment, _) in enumerate(turns):
        calls += [
            _push(LIMIT_N * way * (-1) ** number),
            call("step", duration=max(0.005 * round((moment - before) / 0.005), 0.005)),
        ]
        before = moment
    return [*calls, *_look(0.005)[1:]]


def solve(task):
    """A push, the same much later, a swing pumped wide and left free, and what is left of it."""
    exchanges = []

    def taken(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        return readings[-2]["position"][0], readings[-1]["velocity"][0]

    calls = [*_look(0.005), _push(LIMIT_N), *(_look(FIRST_S) * 8)]
    taken(calls, (yield calls))
    terms = _terms(_readings(exchanges), "V")[1]
    period = 2 * pi / sqrt(terms[0] / MASS)
    calls = [call("step", duration=PAUSE_S), *(_look(period / 13) * 8)]
    place, velocity = taken(calls, (yield calls))
    terms = _terms(_readings(exchanges), "V")[1]
    for _ in range(PUMPS):
        calls = _pump(terms, place, velocity)
        place, velocity = taken(calls, (yield calls))
    calls = [_push(0.0), *(_look(period / 13) * 12)]
    taken(calls, (yield calls))
    calls = [call("step", duration=0.005 * round(5 * period / 0.005)), *(_look(period / 13) * 7)]
    taken(calls, (yield calls))
    yield [answer(_prediction(_best(exchanges)))]


def structure(knobs):
    """Which kinds of loss there are."""
    return knobs["kind"]


def theory(knobs):
    """The swing of the loaded carriage, from turn to turn."""
    return _prediction([knobs[name] for name in ("k", "c", "q", "c3", "k2", "tau")])


def measure(engine, knobs):
    """The loaded carriage let go, its fifth turn on the side of the start."""
    engine = engine.changed({"geom[object_1_geom].mass": LOADED})
    for body in (CARRIAGE, "plunger"):
        engine.place(body, np.array([OUT_M, 0.0, 0.0]), {})
    before, turns = 0.0, 0
    while turns < SWINGS:
        engine.step(1)
        velocity = float(engine.twist(CARRIAGE).linear[0])
        turns += before > 0 >= velocity
        before = velocity
    return float(engine.pose(CARRIAGE).position[0])


def naive(knobs):
    """The decrement of a small swing in the laboratory; a resistance in proportion to the speed, as strong as there."""
    swings = exp(-pi * SWINGS * knobs["lab"] / (sqrt(knobs["k"]) * MASS))
    slower = exp(-pi * SWINGS * knobs["lab"] / (sqrt(knobs["k"] * LOADED)))
    return {"same decrement": swings, "in proportion to the speed": slower}


def stage(task):
    """Ask for the force that draws the carriage out by a metre, let it go, and read its fifth maximum."""
    calls = [_push(20.0), _push(LIMIT_N), call("step", duration=10.0), _push(0.0), *(_look(0.1) * 45)]
    readings = yield calls
    places = [reading["position"][0] for reading in readings if "position" in reading]
    turns = [
        place for before, place, after in zip(places, places[1:], places[2:], strict=False) if before < place > after
    ]
    yield [answer(float(turns[min(SWINGS, len(turns)) - 1]) if turns else 0.0)]


def batch(task):
    """A push, its release, and looks at even intervals."""
    calls = [_push(LIMIT_N), *(_look(0.15) * 9), call("step", duration=PAUSE_S), _push(0.0), *(_look(0.15) * 9)]
    readings = yield calls
    yield [answer(_prediction(_best(list(zip(calls, readings, strict=True)))))]
