"""Scene 49: slow jerks and one fast run let line off; ways and changes of speed tell the pull at each speed."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

SLEDGE, TRACTOR, ASKED_M_S = "object_1", "object_2", 3.0
START_M, NEAREST_M, LINE_M, BRISK = 1.6, 0.36, 0.8, 3.2
READ_M, READ_M_S = 4e-4, 4.5e-5
"""Standard deviations of differences of readings."""
FIRST_N, GROWTH, FIRST_S, SEEN_M_S = 0.001, 60.0, 0.1, 0.005
"""First push; how much each is stronger than the one before, how long they are, and the speed that tells the mass."""
CREEP_M_S, LOOK_M, MOST_LOOKS = 0.22, 0.3, 6
""" speed with which the end of the slack is sought, way between looks and their number."""
FIRST_JERK_M_S, PORTIONS_M, COAST_M = 0.25, (0.025, 0.2, 0.0), 0.06
"""Speed of the first slow jerk, line that each later one is to let off, and way without a push before it."""
IN_RUN_S = 0.06, 0.15
"""When the last jerk is looked at: after the line is straight, and again."""
LEG_M, LEGS, RUNNING_M, RUNNING_S, PARTS, SLOW_M_S, CALLS = 0.04, 5, 0.01, 0.02, 5, 0.04, 146
"""The fast run: line between two looks, and looks in an iteration; line and time after which the drum runs
steadily; parts of a leg in the fit; least speed; most calls."""
KINDS = ("dry", "linear", "square")
LOW, HIGH = (0.7, 0.7, np.log(0.1), np.log(1.0)), (1.4, 1.4, np.log(4.0), np.log(2.5))
"""Bounds of the masses over those by the momentum, and of the logarithms of slowing and unit of speed."""


def _brake(kind, w):
    """Pull at a speed in units, over the pull at which the drum begins to turn."""
    if kind == "dry":
        return 1.0 + 0.0 * w
    return 1.0 + (w if kind == "linear" else w**2)


def _push(force):
    return call("apply_force", object_id=TRACTOR, force_vector=[float(f"{force:.5g}"), 0, 0])


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
        own = float(table[:, 0] @ impulse / (table[:, 0] @ table[:, 0]))
        return np.array([own, own])
    return np.clip(np.linalg.lstsq(table, impulse, rcond=None)[0], 1e-5, 1e3)


def _passages(rows):
    """Legs during which line ran off all the time, and jerks from a slack line to one that holds: starts and ends."""
    reached = np.maximum.accumulate(rows[:, 1])
    moved = np.nonzero(rows[:, 3] > 0.004)[0]
    if not len(moved):
        return (rows[:0], rows[:0]), (rows[:0], rows[:0], reached[:0])
    straight = reached[moved[0]]
    first, last = rows[:-1], rows[1:]
    before, after = first[:, 2] - first[:, 3], last[:, 2] - last[:, 3]
    still = (abs(rows[:, 2] - rows[:, 3]) < 0.004) | (rows[:, 1] < reached - 0.005)
    held = np.maximum.accumulate(np.where(still, reached, 0.0))[:-1]
    legs = (first[:, 1] > held + RUNNING_M + RUNNING_S * before) & (before > SLOW_M_S) & (after > SLOW_M_S)
    legs &= (last[:, 3] - first[:, 3] > 5e-4) & (reached[1:] < straight + LINE_M - 0.06)
    # The end of the line stops the relative motion at once; the leg before may have met it in its last time step.
    going = np.append(after[1:], after[-1:])
    legs &= (last[:, 4] <= 0) | (np.minimum(after, going) > 0.8 * before)
    jerks = (last[:, 4] == 0) & (first[:, 1] < reached[:-1] - 0.02) & (before > 0.1) & (abs(after) < 0.004)
    jerks &= (last[:, 1] > reached[:-1] + 0.003) & (np.arange(len(first)) > moved[0])
    return (first[legs], last[legs]), (first[jerks], last[jerks], reached[:-1][jerks])


def _misfits(rows, kind):
    """Misfits of speeds, ways and momenta, and what turns their constants into masses, hold and unit of speed.

    The constants are both masses over those that the momentum tells, the logarithm of the slowing of the relative
    motion at slow speed, and that of the unit of speed.
    """
    (first, last), (slack, held, length) = _passages(rows)
    duration, push = last[:, 0] - first[:, 0], last[:, 4]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    speeds = np.outer(slack[:, 2] - slack[:, 3], (nodes + 1) / 2)
    masses = _masses(rows)
    momentum = READ_M_S * np.hypot(*masses)
    steps = np.diff(rows[:, 2:4], axis=0), np.diff(rows[:, 5])

    def brake(p):
        m1, m2 = p[:2] * masses
        return m1, m2, np.exp(p[2]) * m1 * m2 / (m1 + m2), np.exp(p[3])

    def misfit(p):
        m1, m2, hold, unit = brake(p)
        fast, slow = first[:, 2], first[:, 3]
        for _ in range(PARTS):
            pull = hold * _brake(kind, np.maximum(fast - slow, 0.0) / unit)
            middle = fast - slow + duration / PARTS / 2 * ((push - pull) / m1 - pull / m2)
            pull = hold * _brake(kind, np.maximum(middle, 0.0) / unit)
            fast, slow = fast + duration / PARTS * (push - pull) / m1, slow + duration / PARTS * pull / m2
        way = speeds / np.exp(p[2]) / _brake(kind, speeds / unit)
        way = (way @ weights) / 2 * (slack[:, 2] - slack[:, 3])
        ways = (way - (held[:, 1] - length)) / np.hypot(READ_M, 0.004 * np.abs(held[:, 1] - length))
        pushed = (steps[0] @ np.array([m1, m2]) - steps[1]) / momentum
        return np.concatenate([(fast - last[:, 2]) / READ_M_S, (slow - last[:, 3]) / READ_M_S, ways, pushed])

    return misfit, brake


def _fitted(rows, kind):
    """Chi-square, misfits, the best constants, and what turns them into masses, hold and unit of speed."""
    misfit, brake = _misfits(rows, kind)
    fits = [
        least_squares(misfit, (1.0, 1.0, np.log(slowing), np.log(unit)), bounds=(LOW, HIGH), x_scale="jac", max_nfev=60)
        for slowing in (0.4, 0.9)
        for unit in (1.2, 2.0)
    ]
    best = min(fits, key=lambda got: got.cost)
    return 2 * best.cost, misfit, best.x, brake


def rivals(readings):
    """Each kind of brake, fitted."""
    rows, found = _rows(readings), {}
    for kind in KINDS:
        _, misfit, best, brake = _fitted(rows, kind)
        found[kind] = member(
            misfit, lambda p, kind=kind, brake=brake: _run_off(kind, *brake(p)), best, list(zip(LOW, HIGH, strict=True))
        )
    return found


def _run_off(kind, m1, m2, hold, unit):
    """Line that runs off until the relative speed is gone."""
    way = quad(lambda v: v / _brake(kind, v / unit), 0.0, ASKED_M_S)[0]
    return float(m1 * m2 / (m1 + m2) / hold * way)


def fit(readings, structure):
    """The answer by a kind of brake."""
    _, _, best, brake = _fitted(_rows(readings), structure)
    return _run_off(structure, *brake(best))


def _best(exchanges):
    """The answer by the brake that fits best."""
    rows = _rows(exchanges)
    fits = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(KINDS, key=lambda name: fits[name][0])
    return _run_off(kind, *fits[kind][3](fits[kind][2]))


def _run_up(mass, way, speed):
    """Back by less than a way, and forth again up to a speed, short of where it began."""
    speed = min(speed, np.sqrt(2 * BRISK * (way - COAST_M)))
    back = np.sqrt((COAST_M + speed**2 / (2 * BRISK)) / BRISK)
    push = BRISK * mass
    return [_push(-push), _wait(back), _push(push), _wait(back + speed / BRISK), _push(0.0), *_look(0.005)]


def solve(task):
    """Coast to where the line is straight, let line off by slow jerks, then by a fast run."""
    exchanges = []

    def made(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        return _rows(exchanges)

    push, rows = FIRST_N, np.zeros((1, 6))
    while rows[-1, 2] < SEEN_M_S:
        calls = [*([] if exchanges else [call("find_objects")]), _push(push), *_look(FIRST_S)]
        rows = made(calls, (yield calls))
        push *= GROWTH
    mass = _masses(rows[-2:])[0] if len(rows) > 2 else _masses(rows)[0]
    more = CREEP_M_S - rows[-1, 2]
    calls = [_push(np.sign(more) * BRISK * mass), _wait(abs(more) / BRISK), _push(0.0)]
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
        calls = _run_up(mass, rows[-1, 1] - NEAREST_M, speed)
        rows = made(calls, (yield calls))
        v, length = rows[-1, 2] - rows[-1, 3], np.max(rows[:, 1])
        straight = (length - rows[-1, 1]) / v
        calls = _look(straight + 0.6 / v)
        if not portion:
            calls = [*_look(straight + IN_RUN_S[0]), *_look(IN_RUN_S[1]), *_look(1.2)]
        rows = made(calls, (yield calls))
        way = max(rows[-1, 1] - length, 0.002)
        speed = v * float(np.clip(np.sqrt(portion / way), 0.5, 4.0))
    back = np.sqrt((rows[-1, 1] - NEAREST_M) / BRISK)
    full = BRISK * back * np.sqrt(2)
    calls = [
        _push(-BRISK * mass),
        _wait(back),
        _push(BRISK * mass),
        *_look(back + full / BRISK - 0.02),
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
    """Pull with a large force until the line is off, and say how much there was."""
    readings = yield [call("find_objects"), _push(1000.0), *_look(2.5)]
    gap = float(readings[-4]["position"][0] - readings[-3]["position"][0])
    yield [answer(min(gap - START_M, LINE_M))]


def batch(task):
    """Ever stronger pushes for tractors of middle mass, with two looks at each."""
    calls = [call("find_objects")]
    for number in range(5):
        calls += [_push(0.1 * 2.2**number), *(_look(0.5) * 2)]
    exchanges = list(zip(calls, (yield calls), strict=True))
    try:
        value = _best(exchanges)
    except (ValueError, ArithmeticError, IndexError):
        value = 10.0
    yield [answer(value)]
