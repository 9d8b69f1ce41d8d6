"""Scene 39: swings pushed, pumped and free give a balance of momentum, whose terms say what takes the energy."""

from itertools import combinations, pairwise
from math import exp, pi, sqrt

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

CARRIAGE = "object_1"
MASS, LOADED = 1.0, 16.0
OUT_M, SWINGS = 3.0, 2
LIMIT_N = 2.0
FIRST_S = 0.1
PUMPS, HALVES = 3, 5
PAUSE_S = 4.0
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
PENALTY = 8.0
SUBSTEP_S, LEAST = 0.03, 1e-3
SLOW = 0.01
"""Speed below which a constant resistance fades, m/s."""
MOST = 30.0
"""No place or velocity is larger; trial terms may diverge."""
SIGMA = np.array([1.5e-4, 6e-4])
"""Errors of place and velocity."""
TERMS = "VBQC"
RANGES = np.array([(10.0, 300.0), (0.0, 10.0), (0.0, 1.0), (0.0, 8.0), (0.0, 8.0)])
"""Ranges of the stiffness and of the strengths."""
STRUCTURES = ["".join(kinds) for count in (1, 2) for kinds in combinations(TERMS, count)]
"""Kinds of resistance, alone and in pairs: in proportion to the speed, constant, its square, its cube."""


def _powers(v):
    """All kinds of resistance of unit strength."""
    return np.array([v, np.tanh(v / SLOW), v * abs(v), v**3])


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
    """Weights, places and velocities at the points of an interval, by the cubic through both ends."""
    span = end[0] - begin[0]
    s = (POINTS + 1) / 2
    x0, v0, x1, v1 = begin[1], begin[2] * span, end[1], end[2] * span
    a, b = 2 * (x0 - x1) + v0 + v1, 3 * (x1 - x0) - 2 * v0 - v1
    return WEIGHTS * span / 2, x0 + s * (v0 + s * (b + s * a)), (v0 + s * (2 * b + 3 * s * a)) / span


def _balance(stretches):
    """What spring and resistance must explain in each interval: columns, and the momentum."""
    columns, momentum = [], []
    for rows in stretches:
        for begin, end in pairwise(rows):
            weight, x, v = _path(begin, end)
            columns.append([weight @ x, *(_powers(v) @ weight)])
            momentum.append(end[3] * (end[0] - begin[0]) - MASS * (end[2] - begin[2]))
    return np.array(columns), np.array(momentum)


def _rough(stretches, kinds):
    """Misfit, and the best stiffness and strengths with only these kinds of resistance."""
    columns, momentum = _balance(stretches)
    used = [0, *(1 + TERMS.index(kind) for kind in kinds)]
    found, *_ = np.linalg.lstsq(columns[:, used], momentum, rcond=None)
    values = np.zeros(1 + len(TERMS))
    values[used] = np.maximum(found, LEAST)
    return float(np.sum((columns @ values - momentum) ** 2)), values


def _events(exchanges):
    """All steps, each with the push during it and what was read after it, or None: (seconds, push, reading)."""
    push, events, place = 0.0, [], 0.0
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
    """What would be read with these terms, an array (5, n) of n cases: shape (readings, 2, n)."""
    state, found = np.zeros((2, terms.shape[1])), []

    def slope(s, push):
        x, v = np.clip(s, -MOST, MOST)
        return np.array([v, (push - terms[0] * x - np.sum(terms[1:] * _powers(v), axis=0)) / MASS])

    for seconds, push, read in events:
        count = int(np.ceil(seconds / SUBSTEP_S))
        h = seconds / count
        for _ in range(count):
            a = slope(state, push)
            b = slope(state + h / 2 * a, push)
            d = slope(state + h / 2 * b, push)
            state = state + h / 6 * (a + 2 * b + 2 * d + slope(state + h * d, push))
        if read:
            found.append(state)
    return np.array(found)


def _refined(events, kinds, start, rounds=14):
    """The terms fitted to all that was read since the start, and a score: low for few and small misfits."""
    read = np.array([reading for *_, reading in events if reading])
    free = [0, *(1 + TERMS.index(kind) for kind in kinds)]

    def terms(values):
        all_terms = np.zeros((1 + len(TERMS), *values.shape[1:]))
        all_terms[free] = np.exp(np.clip(values, -12.0, 7.0))
        return all_terms

    def misfit(values):
        return ((_swing(events, terms(values[:, None]))[:, :, 0] - read) / SIGMA).ravel()

    def jacobian(values):
        cases = np.hstack([values[:, None], values[:, None] + 1e-4 * np.eye(len(values))])
        swings = (_swing(events, terms(cases)) / SIGMA[:, None]).reshape(-1, cases.shape[1])
        return (swings[:, 1:] - swings[:, :1]) / 1e-4

    begin = np.log(np.asarray(start)[free])
    found = least_squares(misfit, begin, jac=jacobian, x_scale=0.1, max_nfev=rounds)
    return 2 * found.cost + PENALTY * len(free), terms(found.x)


def _best(exchanges, structures=STRUCTURES):
    """The best terms of these kinds of resistance: the likeliest by the balance, refined."""
    stretches, events = _readings(exchanges), _events(exchanges)
    rough = sorted(((*_rough(stretches, kinds), kinds) for kinds in structures), key=lambda fit: fit[0])
    return min((_refined(events, kinds, start) for _, start, kinds in rough[:3]), key=lambda fit: fit[0])[1]


def _turns(terms, mass, push, start, count):
    """Times and places of the next turns from a state (place, velocity)."""
    stiffness, strengths = terms[0], np.asarray(terms[1:])
    state, clock, turns = list(start), 0.0, []
    for _ in range(count):
        drive = push(turns) if callable(push) else push
        way = np.sign(state[1]) if abs(state[1]) > 1e-9 else np.sign(drive - stiffness * state[0])

        def slope(_, s, drive=drive):
            return [s[1], (drive - stiffness * s[0] - float(strengths @ _powers(s[1]))) / mass]

        def turned(_, s, way=way):
            return way * s[1]

        turned.terminal, turned.direction = True, -1
        run = solve_ivp(slope, (0, 50), state, events=turned, rtol=1e-7, atol=1e-9)
        state, clock = [run.y[0, -1], 0.0], clock + run.t[-1]
        turns.append((clock, state[0]))
    return turns


def _prediction(terms):
    """Where the loaded carriage turns at the end of the asked swing."""
    return float(_turns(terms, LOADED, 0.0, (OUT_M, 0.0), 2 * SWINGS)[-1][1])


def fit(readings, structure):
    """The place by the kinds of resistance of a structure."""
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
    turns = _turns(terms, MASS, lambda done: LIMIT_N * way * (-1) ** len(done), (place, velocity), HALVES)
    calls, before = [], 0.0
    for number, (moment, _) in enumerate(turns):
        calls += [
            _push(LIMIT_N * way * (-1) ** number),
            call("step", duration=max(0.005 * round((moment - before) / 0.005), 0.005)),
        ]
        before = moment
    return [*calls, *_look(0.005)[1:]]


def solve(task):
    """A push, the same later, a swing pumped wide and left free, and what is left of it."""
    exchanges = []

    def taken(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        return readings[-2]["position"][0], readings[-1]["velocity"][0]

    calls = [*_look(0.005), _push(LIMIT_N), *(_look(FIRST_S) * 8)]
    taken(calls, (yield calls))
    terms = _rough(_readings(exchanges), "V")[1]
    period = 2 * pi / sqrt(terms[0] / MASS)
    calls = [call("step", duration=PAUSE_S), *(_look(period / 13) * 4)]
    place, velocity = taken(calls, (yield calls))
    for _ in range(PUMPS):
        calls = _pump(terms, place, velocity)
        place, velocity = taken(calls, (yield calls))
        terms = _best(exchanges, ["V", "Q"])
    calls = [_push(0.0), *(_look(period / 13) * 13)]
    taken(calls, (yield calls))
    calls = [call("step", duration=0.005 * round(2 * period / 0.005)), *(_look(period / 13) * 8)]
    taken(calls, (yield calls))
    yield [answer(_prediction(_best(exchanges)))]


def rivals(readings):
    """Each resistance, and each sum of two, fitted."""
    stretches, events = _readings(readings), _events(readings)
    read = np.array([reading for *_, reading in events if reading])

    def weighed(kinds):
        free = [0, *(1 + TERMS.index(kind) for kind in kinds)]
        _, terms = _refined(events, kinds, _rough(stretches, kinds)[1], 20)

        def every(constants):
            values = np.zeros(1 + len(TERMS))
            values[free] = constants
            return values

        return member(
            lambda constants: ((_swing(events, every(constants)[:, None])[:, :, 0] - read) / SIGMA).ravel(),
            lambda constants: _prediction(every(constants)),
            terms[free],
            RANGES[free],
        )

    return {kinds: weighed(kinds) for kinds in STRUCTURES}


def structure(knobs):
    """Which kinds of resistance there are."""
    return knobs["kind"]


def theory(knobs):
    """The swing of the loaded carriage, from turn to turn."""
    return _prediction([knobs[name] for name in ("k", "c", "b", "q", "c3")])


def measure(engine, knobs):
    """The loaded carriage let go, its second turn on the side of the start."""
    engine = engine.changed({"geom[object_1_geom].mass": LOADED})
    engine.place(CARRIAGE, np.array([OUT_M, 0.0, 0.0]), {})
    before, turns = 0.0, 0
    while turns < SWINGS:
        engine.step(1)
        velocity = float(engine.twist(CARRIAGE).linear[0])
        turns += before > 0 >= velocity
        before = velocity
    return float(engine.pose(CARRIAGE).position[0])


def naive(knobs):
    """The decrement of a small swing in the laboratory; a resistance in proportion to the speed, as strong as there."""
    swings = OUT_M * exp(-pi * SWINGS * knobs["lab"] / (sqrt(knobs["k"]) * MASS))
    slower = OUT_M * exp(-pi * SWINGS * knobs["lab"] / (sqrt(knobs["k"] * LOADED)))
    return {"same decrement": swings, "in proportion to the speed": slower}


def stage(task):
    """Ask for the force that draws the carriage out by 3 m, let it go, and read its second maximum."""
    calls = [_push(100.0), _push(LIMIT_N), call("step", duration=10.0), _push(0.0), *(_look(0.1) * 45)]
    readings = yield calls
    places = [reading["position"][0] for reading in readings if "position" in reading]
    turns = [
        place for before, place, after in zip(places, places[1:], places[2:], strict=False) if before < place > after
    ]
    yield [answer(float(turns[min(SWINGS, len(turns)) - 1]) if turns else 0.0)]


def batch(task):
    """Pushes to and fro that become faster, with a look after each, then a free swing."""
    calls, moments = [], np.geomspace(0.75, 0.25, 11)
    for number, seconds in enumerate(moments):
        calls += [_push(LIMIT_N * (-1) ** number), *_look(float(seconds))]
    calls += [_push(0.0), *(_look(0.12) * 5)]
    readings = yield calls
    yield [answer(_prediction(_best(list(zip(calls, readings, strict=True)))))]
