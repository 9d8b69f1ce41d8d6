"""Scene 99: swing all drums within their catches, let them drift, fit each inside, compute the strong pulse."""

import math
from itertools import permutations, product

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

INSIDES = ("single", "oil", "spring", "clutch", "single")
"""By number of content. What nothing joins to its drum, a drum does not feel."""
STRONG, PULSE_S, LATER_S = 40.0, 1.0, 15.0
TORQUE, REACH, PROBES_S = 0.5, 2.6, (0.05, 0.25, 1.2)
DRIFT, DRIFT_S = 2.8, 40.0
"""Angle of the slow drift [rad] and its time [s]."""
RESOLUTION = 0.002
CATCH, SAME = 3.97, 1e-9
"""Greatest angle of a free drum [rad]; spins closer than this are equal [rad/s]."""


def _velocity_matrix(kind, p):
    """Equations of motion of (shell, core, twist), and the effect of a torque on the shell."""
    if kind == "single":
        whole, rub = p
        return np.array([[-rub / whole]]), np.array([1 / whole])
    shell, core, rub, oil = p[:4]
    rows = [[-(rub + oil) / shell, oil / shell], [oil / core, -oil / core]]
    if kind == "oil":
        return np.array(rows), np.array([1 / shell, 0])
    stiff = p[4]
    rows = [[*rows[0], -stiff / shell], [*rows[1], stiff / core], [1, -1, 0]]
    return np.array(rows), np.array([1 / shell, 0, 0])


def _linear(kind, p, changes, times):
    """Angles and spins at `times` after `changes` of the torque: (moment, difference)."""
    matrix, drive = _velocity_matrix(kind, p)
    rates, modes = np.linalg.eig(matrix)
    weights = modes[0] * np.linalg.solve(modes, drive.astype(complex))
    angle, spin = np.zeros(len(times), complex), np.zeros(len(times), complex)
    for moment, difference in changes:
        since = np.maximum(times - moment, 0.0)[:, None] * rates
        grown = np.expm1(since)
        spin += difference * (grown / rates) @ weights
        angle += difference * ((grown - since) / rates**2) @ weights
    return angle.real, spin.real


def _clutch(p, changes, times):
    """As `_linear`, for a core that slips when the clutch would have to give more than `grip`."""
    shell, core, rub, grip = p
    ends = [*(moment for moment, _ in changes[1:]), times[-1] + 1.0]
    angles, spins = np.zeros(len(times)), np.zeros(len(times))
    done, angle, spin, inner, torque = 0, 0.0, 0.0, 0.0, 0.0
    for (start, difference), end in zip(changes, ends, strict=True):
        torque, now = torque + difference, start
        while now < end:
            pull, slip = core * (torque - rub * spin) / (shell + core), spin - inner
            stuck = abs(slip) < SAME and abs(pull) <= grip
            way = 0.0 if stuck else math.copysign(1.0, slip if abs(slip) >= SAME else pull)
            gain, fade = way * grip / core, rub / (shell + core if stuck else shell)
            final = (torque - way * grip) / rub

            def ahead(span, spin=spin, inner=inner, final=final, fade=fade, gain=gain, way=way):
                return way * (final + (spin - final) * math.exp(-fade * span) - inner - gain * span)

            span = end - now
            met = not stuck and ahead(span) < 0
            if met:
                span = brentq(ahead, 1e-7, span) if ahead(1e-7) > 0 else 1e-7
            last = int(np.searchsorted(times, now + span)) if now + span < end else int(np.searchsorted(times, end))
            since = np.append(times[done:last] - now, span)
            turned = angle + final * since - (spin - final) * np.expm1(-fade * since) / fade
            speeds = final + (spin - final) * np.exp(-fade * since)
            angles[done:last], spins[done:last] = turned[:-1], speeds[:-1]
            done, now, angle, spin = last, now + span, turned[-1], speeds[-1]
            inner = spin if stuck or met else inner + gain * span
    return angles, spins


def motion(kind, p, changes, times):
    """Angles and spins of a drum of a kind at rising times."""
    times = np.asarray(times, float)
    if kind == "clutch":
        return _clutch(p, changes, times)
    return _linear(kind, p, changes, times)


def _logs(exchanges):
    """Of each drum the changes of its torque, and times and angles read."""
    clock, torque, changes, read = 0.0, {}, {}, {}
    for made, reading in exchanges:
        drum = made.arguments.get("object_id")
        if made.tool == "apply_torque":
            wanted = made.arguments["torque_vector"][2]
            changes.setdefault(drum, []).append((clock, wanted - torque.get(drum, 0.0)))
            torque[drum] = wanted
        elif made.tool == "get_position":
            read.setdefault(drum, []).append((clock, reading["angle"]))
        clock = reading.get("sim_time", clock)
    return changes, {drum: np.array(rows) for drum, rows in read.items()}


SHELL = (0.35, 0.75)
BOUNDS = {
    "single": [],
    "oil": [SHELL, (1, 12)],
    "clutch": [SHELL, (0.05, 0.11)],
    "spring": [SHELL, (1, 6), (0.04, 0.2)],
}
"""As the task says: share of the shell; then time, greatest torque, or frequency and damping ratio."""
WHOLE, BEARING_S, ALONE_S = (0.01, 13), (40, 160), (14, 160)
"""Moment of inertia and its time in the bearing; that of a drum whose core nothing joins to it may be shorter."""
STARTS = {
    "single": [()],
    "oil": list(product((0.4, 0.65), (1.5, 6))),
    "clutch": list(product((0.4, 0.65), (0.06, 0.1))),
    "spring": list(product((0.4, 0.65), np.geomspace(1.02, 5.8, 8), (0.1,))),
}


def _parts(kind, whole, time, share=1.0, *more):
    """Shell, core and so on, as `motion` needs them, from whole inertia, bearing time, share and the rest."""
    shell, core, rub = whole * share, whole * (1 - share), whole / time
    reduced = shell * (1 - share)
    if kind == "single":
        return whole, rub
    if kind == "oil":
        return shell, core, rub, reduced / more[0]
    if kind == "clutch":
        return shell, core, rub, more[0]
    return shell, core, rub, 2 * more[1] * reduced * more[0], reduced * more[0] ** 2


def _ranges(kind):
    """Logarithms of the least and the greatest value of each constant of a drum of a kind."""
    return np.log([WHOLE, ALONE_S if kind == "single" else BEARING_S, *BOUNDS[kind]])


def _misfits(kind, changes, read):
    """How far a drum as of a kind is off each reading, in standard deviations. Nothing counts from the catch on."""
    free = np.logical_and.accumulate(np.abs(read[:, 1]) < CATCH)
    times, angles = read[free].T

    def off(logs):
        turned = motion(kind, _parts(kind, *np.exp(logs)), changes, times)[0]
        return np.nan_to_num((turned - angles) / (RESOLUTION / 3), nan=1e6, posinf=1e6, neginf=-1e6)

    return off


def _fitted(kind, changes, read):
    """Chi-square and constants of a drum as of a kind, and the misfits as a function of the constants."""
    off, (low, high) = _misfits(kind, changes, read), _ranges(kind).T
    wholes = np.geomspace(0.012, 12, 24)
    starts = [np.log([whole, 80.0, *more]) for whole in wholes for more in STARTS[kind]]
    starts.sort(key=lambda logs: float(np.sum(off(logs) ** 2)))
    found = [least_squares(off, logs, bounds=(low, high), max_nfev=40, ftol=1e-6, xtol=1e-6) for logs in starts[:4]]
    best = min(found, key=lambda fitted: fitted.cost)
    return 2 * float(best.cost), best.x, off


def _table(exchanges):
    """Every drum fitted as of every kind: for each drum a row by kind."""
    changes, read = _logs(exchanges)
    return [{kind: _fitted(kind, changes[drum], read[drum]) for kind in BOUNDS} for drum in sorted(read)]


def _orders():
    """Every way in which the insides can be shared out to the drums."""
    return sorted(set(permutations(INSIDES)))


def _predict(insides):
    """Spins of all drums long after the strong pulse, from kind and parameters of each drum."""
    changes = [(0.0, STRONG), (PULSE_S, -STRONG)]
    times = [PULSE_S, PULSE_S + LATER_S]
    return [float(motion(kind, p, changes, times)[1][-1]) for kind, p in insides]


def _foretold(order, each):
    """The prediction from the logarithms of the constants of each drum."""
    return _predict([(kind, _parts(kind, *np.exp(logs))) for kind, logs in zip(order, each, strict=True)])


def fit(readings, structure):
    """The prediction, with the insides of a structure: kinds of the drums in order."""
    changes, read = _logs(readings)
    order = structure.split(", ")
    rows = zip(order, sorted(read), strict=True)
    return _foretold(order, [_fitted(kind, changes[drum], read[drum])[1] for kind, drum in rows])


def _guess(exchanges):
    """The prediction, with the insides shared out as fits best."""
    table = _table(exchanges)
    best = min(_orders(), key=lambda order: sum(row[kind][0] for kind, row in zip(order, table, strict=True)))
    return _foretold(best, [row[kind][1] for kind, row in zip(best, table, strict=True)])


def _shared_out(order, table):
    """The member of the family with these insides."""
    columns = [row[kind] for kind, row in zip(order, table, strict=True)]
    sizes = [len(logs) for _, logs, _ in columns]

    def apart(logs):
        return np.split(logs, np.cumsum(sizes[:-1]))

    def misfits(logs):
        return np.hstack([column[2](own) for column, own in zip(columns, apart(logs), strict=True)])

    return member(
        misfits,
        lambda logs: _foretold(order, apart(logs)),
        np.hstack([logs for _, logs, _ in columns]),
        np.vstack([_ranges(kind) for kind in order]),
    )


def rivals(readings):
    """The insides in every order."""
    table = _table(readings)
    return {", ".join(order): _shared_out(order, table) for order in _orders()}


def _turn(drums, torque):
    return [call("apply_torque", object_id=drum, torque_vector=[0, 0, torque]) for drum in drums]


def _look(drums, spans):
    """Angles of all drums after each span."""
    return [
        made
        for span in spans
        for made in (
            call("step", duration=round(round(span / 0.005) * 0.005, 3)),
            *(call("get_position", object_id=drum) for drum in drums),
        )
    ]


def _swing(drums, spans):
    """The full torque for the first span, then the opposite one for the second; angles after that."""
    first, second = spans
    calls = [*_turn(drums, TORQUE), call("step", duration=first), *_turn(drums, -TORQUE)]
    return [*calls, *_look(drums, [second])]


def solve(task):
    """Scale first; then to and fro with the full torque; then a slow drift through most of the room."""
    log = []
    drums = [f"object_{number}" for number in range(1, 6)]
    for probe in PROBES_S:
        calls = [*([] if log else [call("find_objects")]), *_swing(drums, (probe, probe))]
        log += zip(calls, (yield calls), strict=True)
        moved = [max(abs(reading["angle"]), 0.02) for _, reading in log[-5:]]
        if max(moved) > 0.06:
            break
    # Half of the time the torque speeds up and half it brakes: the way is a t².
    beat = probe * math.sqrt(min(REACH, 3.7 - max(moved)) / max(moved))
    calls = [*_turn(drums, TORQUE), *_look(drums, [beat / 2, beat / 2]), *_turn(drums, -TORQUE)]
    calls += [*_look(drums, [beat / 2, beat, beat / 2]), *_turn(drums, TORQUE), *_look(drums, [beat])]
    log += zip(calls, (yield calls), strict=True)
    kick_s = max(round(beat / 2 / 0.005), 1) * 0.005
    gains = np.array(moved) / probe**2 / TORQUE * kick_s
    angles = np.array([_logs(log)[1][drum][-1, 1] for drum in drums])
    # The torques add up to nothing: shell and core together are almost at rest, but for what the bearings took.
    spins = -angles / 80
    sides = -np.sign(angles)
    for left, gain in ((DRIFT_S, gains), (0.9 * DRIFT_S, 0.6 * gains))[: 1 if probe == PROBES_S[-1] else 2]:
        kicks = np.clip(((sides * DRIFT - angles) / left - spins) / gain, -TORQUE, TORQUE)
        calls = [turn for drum, kick in zip(drums, kicks, strict=True) for turn in _turn([drum], kick)]
        calls += [call("step", duration=kick_s), *_turn(drums, 0.0), *_look(drums, [0.03 * DRIFT_S, 0.07 * DRIFT_S])]
        log += zip(calls, (yield calls), strict=True)
        before, angles = angles, np.array([_logs(log)[1][drum][-1, 1] for drum in drums])
        spins = (angles - before) / (0.1 * DRIFT_S + kick_s)
    calls = _look(drums, DRIFT_S * np.array([0.2, 0.3, 0.3]))
    log += zip(calls, (yield calls), strict=True)
    yield [answer(_guess(log))]


def theory(knobs):
    """The strong pulse on each drum, by the motion of shell and core."""
    insides = []
    for number, place in enumerate(knobs["contents"], 1):
        shell, core, rub = (knobs[f"{part}_{number}"] for part in ("shell", "core", "bearing"))
        kind = INSIDES[place]
        more = {
            "single": (shell, rub),
            "oil": (shell, core, rub, knobs[f"oil_{number}"]),
            "spring": (shell, core, rub, knobs[f"oil_{number}"], knobs[f"twist_{number}"]),
            "clutch": (shell, core, rub, knobs[f"dry_{number}"]),
        }
        insides.append((kind, more[kind]))
    return _predict(insides)


def measure(engine, knobs):
    """The engine's own strong pulse, without the catches."""
    drums = [f"object_{number}" for number in range(1, 6)]
    free = {f"joint[{drum}_joint].range": (-1e6, 1e6) for drum in drums}
    engine = engine.changed({**free, **{f"body[trigger_{number}]/inertial.mass": 1e12 for number in range(1, 6)}})
    for drum in drums:
        engine.push(drum, torque=np.array([0, 0, STRONG]))
    engine.step(engine.whole_steps(PULSE_S))
    for drum in drums:
        engine.push(drum, torque=np.zeros(3))
    engine.step(engine.whole_steps(LATER_S))
    return [float(engine.turn(drum).spin) for drum in drums]


def structure(knobs):
    """What each drum holds."""
    return ", ".join(INSIDES[place] for place in knobs["contents"])


def naive(knobs):
    """Every core taken as firmly joined."""
    pairs = []
    for number, place in enumerate(knobs["contents"], 1):
        core = knobs[f"core_{number}"] if INSIDES[place] != "single" else 0.0
        pairs.append((knobs[f"shell_{number}"] + core, knobs[f"bearing_{number}"]))
    return {"joined": _predict([("single", pair) for pair in pairs])}


def batch(task):
    """Fixed swings with the full torque, short ones for light drums and longer ones for heavy drums, and a drift."""
    drums = [f"object_{number}" for number in range(1, 6)]
    calls = [call("find_objects"), *_swing(drums, (0.1, 0.1)), *_turn(drums, TORQUE), *_look(drums, [0.5])]
    calls += [*_turn(drums, -TORQUE), *_look(drums, [0.6]), *_turn(drums, 0.0), *_look(drums, [4.0, 20.0])]
    log = list(zip(calls, (yield calls), strict=True))
    yield [answer(_guess(log))]


def stage(task):
    """Turn every drum with the asked torque."""
    drums = [f"object_{number}" for number in range(1, 6)]
    readings = yield [
        call("find_objects"),
        *_turn(drums, STRONG),
        call("step", duration=PULSE_S),
        *_turn(drums, 0.0),
        *_look(drums, [LATER_S]),
    ]
    angles = [reading["angle"] for reading in readings[-5:]]
    yield [answer([angle / LATER_S for angle in angles])]
