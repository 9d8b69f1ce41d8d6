"""Scene 49: slow jerks and one fast run let line off; ways and changes of speed tell the pull at each speed."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import least_squares

from scenes.protocol import answer, call

SLEDGE, TRACTOR, ASKED_M_S = "object_1", "object_2", 4.5
START_M, NEAREST_M, LINE_M, LIMIT_N = 1.6, 0.36, 0.5, 6.0
READ_M, READ_M_S = 4e-4, 9e-5
"""Standard deviations of differences of readings."""
FIRST_S, CREEP_M_S, LOOK_M, MOST_LOOKS = 0.1, 0.22, 0.22, 8
"""Length of the first push; speed with which the end of the slack is sought, way between looks and their number."""
FIRST_JERK_M_S, PORTIONS_M, COAST_M = 0.25, (0.025, 0.12, 0.0), 0.06
"""Speed of the first slow jerk, line that each later one is to let off, and way without a push before it."""
LEG_M, LEGS, RUNNING_M, RUNNING_S, PARTS, SLOW_M_S, CALLS = 0.04, 6, 0.01, 0.02, 5, 0.04, 144
"""The fast run: line between two looks, and looks in an iteration; line and time after which the drum runs
steadily; parts of a leg in the fit; least speed; most calls."""
KINDS = ("linear", "square", "fading")


def _brake(kind, w):
    """Pull at a speed in units, over the pull at which the drum begins to turn."""
    if kind == "dry":
        return 1.0 + 0.0 * w
    if kind == "fading":
        return 1.0 / (1.0 + w)
    return 1.0 + (w if kind == "linear" else w**2)


def _push(force):
    return call("apply_force", object_id=TRACTOR, force_vector=[round(float(force), 3), 0, 0])


def _wait(duration):
    return call("step", duration=round(0.005 * max(round(float(duration) / 0.005), 1), 3))


def _look(duration):
    reads = [call(tool, object_id=body) for tool in ("get_position", "get_velocity") for body in (TRACTOR, SLEDGE)]
    return [_wait(duration), *reads]


def _rows(exchanges):
    """Rows of time, gap, speeds of tractor and sledge, force since the row before, and impulse up to then."""
    rows, force, impulse, time, found = [(0.0, START_M, 0.0, 0.0, 0.0, 0.0)], 0.0, 0.0, 0.0, {}
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            time, impulse = time + asked.arguments["duration"], impulse + force * asked.arguments["duration"]
            found = {}
        elif asked.tool in ("get_position", "get_velocity"):
            kind = asked.tool[4:]
            found[kind, asked.arguments["object_id"] == TRACTOR] = reading[kind][0]
            if len(found) == 4:
                gap = found["position", True] - found["position", False]
                rows.append((time, gap, found["velocity", True], found["velocity", False], force, impulse))
                found = {}
    return np.array(rows)


def _masses(rows):
    """Masses from the momentum at each look; the tractor's alone where the sledge has not moved yet."""
    table, impulse = rows[1:, 2:4], rows[1:, 5]
    if np.max(np.abs(table[:, 1])) < 0.01:
        return np.array([float(table[:, 0] @ impulse / (table[:, 0] @ table[:, 0])), 2.0])
    return np.clip(np.linalg.lstsq(table, impulse, rcond=None)[0], 0.1, 50.0)


def _passages(rows):
    """Legs during which line ran off all the time, and jerks from a slack line to one that holds: starts and ends."""
    reached = np.maximum.accumulate(rows[:, 1])
    moved = np.nonzero(rows[:, 3] > 0.004)[0]
    if not len(moved):
        return (rows[:0], rows[:0]), (rows[:0], rows[:0], reached[:0])
    straight = reached[moved[0]]
    first, last = rows[:-1], rows[1:]
    before, after = first[:, 2] - first[:, 3], last[:, 2] - last[:, 3]
    held = np.maximum.accumulate(np.where(abs(rows[:, 2] - rows[:, 3]) < 0.004, rows[:, 1], 0.0))[:-1]
    legs = (first[:, 1] > held + RUNNING_M + RUNNING_S * before) & (before > SLOW_M_S) & (after > SLOW_M_S)
    legs &= (last[:, 3] - first[:, 3] > 5e-4) & (reached[1:] < straight + LINE_M - 0.02)
    jerks = (last[:, 4] == 0) & (first[:, 1] < reached[:-1] - 0.02) & (before > 0.1) & (abs(after) < 0.004)
    jerks &= (last[:, 1] > reached[:-1] + 0.003) & (np.arange(len(first)) > moved[0])
    return (first[legs], last[legs]), (first[jerks], last[jerks], reached[:-1][jerks])


def _fitted(rows, kind):
    """Misfit, masses, and hold and unit of speed of a brake."""
    m1, m2 = _masses(rows)
    reduced = m1 * m2 / (m1 + m2)
    (first, last), (slack, held, length) = _passages(rows)
    duration, push = last[:, 0] - first[:, 0], last[:, 4]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    speeds = np.outer(slack[:, 2] - slack[:, 3], (nodes + 1) / 2)

    def misfit(p):
        hold, unit = np.exp(p)
        fast, slow = first[:, 2], first[:, 3]
        for _ in range(PARTS):
            pull = hold * _brake(kind, np.maximum(fast - slow, 0.0) / unit)
            middle = fast - slow + duration / PARTS / 2 * ((push - pull) / m1 - pull / m2)
            pull = hold * _brake(kind, np.maximum(middle, 0.0) / unit)
            fast, slow = fast + duration / PARTS * (push - pull) / m1, slow + duration / PARTS * pull / m2
        way = reduced / hold * speeds / _brake(kind, speeds / unit)
        way = (way @ weights) / 2 * (slack[:, 2] - slack[:, 3])
        ways = (way - (held[:, 1] - length)) / (READ_M + 0.004 * way)
        return np.concatenate([(fast - last[:, 2]) / READ_M_S, (slow - last[:, 3]) / READ_M_S, ways])

    fits = [
        least_squares(
            misfit,
            np.log([hold, unit]),
            bounds=(np.log([0.05, 0.2]), np.log([20.0, 40.0])),
            loss="soft_l1",
            max_nfev=40,
        )
        for hold, unit in ((1.0, 1.2), (1.0, 4.0))
    ]
    best = min(fits, key=lambda got: got.cost)
    return float(best.cost), m1, m2, *np.exp(best.x)


def _run_off(kind, m1, m2, hold, unit):
    """Line that runs off until the relative speed is gone."""
    way = quad(lambda v: v / _brake(kind, v / unit), 0.0, ASKED_M_S)[0]
    return float(m1 * m2 / (m1 + m2) / hold * way)


def fit(readings, structure):
    """The answer by a kind of brake."""
    return _run_off(structure, *_fitted(_rows(readings), structure)[1:])


def _best(exchanges):
    """The answer by the brake that fits best."""
    rows = _rows(exchanges)
    fits = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(KINDS, key=lambda name: fits[name][0])
    return _run_off(kind, *fits[kind][1:])


def _run_up(gain, way, speed):
    """Back by less than a way, and forth again up to a speed, short of where it began; and the speed itself."""
    speed = min(speed, np.sqrt(2 * gain * (way - COAST_M)))
    back = np.sqrt((COAST_M + speed**2 / (2 * gain)) / gain)
    return [_push(-LIMIT_N), _wait(back), _push(LIMIT_N), _wait(back + speed / gain), _push(0.0), *_look(0.005)]


def solve(task):
    """Coast to where the line is straight, let line off by slow jerks, then by a fast run."""
    yield [call("find_objects")]
    exchanges = []

    def made(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        return _rows(exchanges)

    calls = [_push(2.0), *_look(FIRST_S)]
    rows = made(calls, (yield calls))
    gain = LIMIT_N / _masses(rows)[0]
    calls = [_push(LIMIT_N), _wait((CREEP_M_S - rows[-1, 2]) / gain), _push(0.0)]
    for _ in range(MOST_LOOKS):
        calls += [_wait(LOOK_M / CREEP_M_S), call("get_velocity", object_id=SLEDGE)]
        readings = yield calls
        made(calls, readings)
        calls = []
        if readings[-1]["velocity"][0] > 0.004:
            break
    calls = _look(0.7)
    rows = made(calls, (yield calls))
    speed = FIRST_JERK_M_S
    for portion in PORTIONS_M:
        calls = _run_up(gain, rows[-1, 1] - NEAREST_M, speed)
        rows = made(calls, (yield calls))
        v, length = rows[-1, 2] - rows[-1, 3], np.max(rows[:, 1])
        calls = _look((length - rows[-1, 1]) / v + 0.6 / v)
        rows = made(calls, (yield calls))
        way = max(rows[-1, 1] - length, 0.002)
        speed = v * float(np.clip(np.sqrt(portion / way), 0.5, 4.0))
    back = np.sqrt((rows[-1, 1] - NEAREST_M) / gain)
    full = gain * back * np.sqrt(2)
    calls = [
        _push(-LIMIT_N),
        _wait(back),
        _push(LIMIT_N),
        *_look(back + full / gain - 0.02),
        *(_look(LEG_M / full) * LEGS),
    ]
    rows = made(calls, (yield calls))
    v, more = rows[-1, 2] - rows[-1, 3], (CALLS - len(exchanges)) // 5
    if v > SLOW_M_S and more > 0:
        calls = _look(LEG_M / v) * min(more, LEGS)
        rows = made(calls, (yield calls))
    yield [answer(_best(exchanges))]


def structure(knobs):
    """How the brake depends on the speed."""
    return knobs["kind"]


def theory(knobs):
    """The reduced mass times the integral of v dv over the pull."""
    return _run_off(knobs["kind"], *(knobs[name] for name in ("m2", "m1", "hold", "vs")))


def measure(engine, knobs):
    """The blow in the engine, with line enough."""
    free = engine.changed({"joint[drum_joint].range": (-1.0, 1e6)})
    free.set_velocity(TRACTOR, np.array([ASKED_M_S, 0.0, 0.0]))
    free.step(free.whole_steps(1.6))
    while free.twist("drum").linear[0] > 1e-4:
        free.step(20)
    return float(free.pose("drum").position[0])


def naive(knobs):
    """A brake that always pulls as at slow speed; the sledge taken for a fixed post."""
    m1, m2, hold, vs = (knobs[name] for name in ("m2", "m1", "hold", "vs"))
    return {
        "sledge as a fixed post": _run_off(knobs["kind"], m1, 1e9, hold, vs),
        "constant pull": _run_off("dry", m1, m2, hold, vs),
    }


def stage(task):
    """Pull with all force until the line is off."""
    calls = [call("find_objects"), _push(LIMIT_N), *_look(2.5)]
    readings = yield calls
    yield [answer(float(readings[-4]["position"][0] - readings[-3]["position"][0]))]


def batch(task):
    """Pull with all force, with looks at even intervals."""
    calls = [call("find_objects"), _push(LIMIT_N), *_look(0.3), *(_look(0.1) * 10)]
    exchanges = list(zip(calls, (yield calls), strict=True))
    try:
        value = _best(exchanges)
    except (ValueError, ArithmeticError, IndexError):
        value = 10.0
    yield [answer(value)]
