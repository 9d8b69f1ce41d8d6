"""Scene 99: swing all drums within their catches, let them drift, fit each inside, compute the strong pulse."""

import math
from itertools import product

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

KINDS = ("rigid", "oil", "spring", "clutch", "loose")
STRONG, PULSE_S, LATER_S = 40.0, 1.0, 40.0
TORQUE, REACH, FIRST_S = 0.5, 7.0, 0.3
DRIFT, DRIFT_S, KICK_S = 8.0, 40.0, 0.5
"""Angle of the slow drift [rad], its time and that of the kick before it [s]."""
RESOLUTION = 0.03
CATCH, SAME = 11.9, 1e-9
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


def _model(label):
    return "single" if label in {"rigid", "loose"} else label


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


BOUNDS = {
    "single": [],
    "oil": [(0.3, 0.8), (0.6, 20)],
    "clutch": [(0.3, 0.8), (0.03, 0.2)],
    "spring": [(0.3, 0.8), (0.7, 8), (0.02, 0.4)],
}
"""What a run can show of an inside: share of the shell; then time, greatest torque, or frequency and damping ratio."""
STARTS = {
    "single": [()],
    "oil": list(product((0.4, 0.65), (1.5, 6))),
    "clutch": list(product((0.4, 0.65), (0.06, 0.1))),
    "spring": list(product((0.4, 0.65), np.geomspace(1, 6.5, 8), (0.1,))),
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


def _fitted(kind, changes, read):
    """Least misfit and parameters of a drum as of a kind. Readings from the catch on do not count."""
    free = np.logical_and.accumulate(np.abs(read[:, 1]) < CATCH)
    times, angles = read[free].T
    low, high = np.log([(0.005, 3), (10, 3000), *BOUNDS[kind]]).T

    def misfit(logs):
        off = (motion(kind, _parts(kind, *np.exp(logs)), changes, times)[0] - angles) / (RESOLUTION / 3)
        return np.nan_to_num(off, nan=1e6, posinf=1e6, neginf=-1e6)

    wholes = np.geomspace(0.02, 1.3, 12)
    starts = [np.log([whole, 80.0, *more]) for whole in wholes for more in STARTS[kind]]
    starts.sort(key=lambda logs: float(np.sum(misfit(logs) ** 2)))
    found = [least_squares(misfit, logs, bounds=(low, high), max_nfev=30, ftol=1e-6, xtol=1e-6) for logs in starts[:3]]
    best = min(found, key=lambda fitted: fitted.cost)
    return best.cost, _parts(kind, *np.exp(best.x))


def _pick(ways, spins):
    """The drum with the greatest angle and that angle; the drum with the greatest spin and that spin."""
    far, fast = int(np.argmax(ways)), int(np.argmax(spins))
    return [far + 1, float(ways[far]), fast + 1, float(spins[fast])]


def _predict(insides):
    """The answer, from kind and parameters of each drum."""
    changes = [(0.0, STRONG), (PULSE_S, -STRONG)]
    runs = [motion(kind, p, changes, [PULSE_S, PULSE_S + LATER_S]) for kind, p in insides]
    ways, spins = [run[0][0] for run in runs], [run[1][1] for run in runs]
    return _pick(ways, spins)


def fit(readings, structure):
    """The prediction, with the insides of a structure: kinds of the drums in order."""
    changes, read = _logs(readings)
    drums = sorted(read)
    kinds = [_model(kind) for kind in structure.split(", ")]
    return _predict([(k, _fitted(k, changes[d], read[d])[1]) for k, d in zip(kinds, drums, strict=True)])


def _guess(exchanges):
    """The prediction, with the kind of each drum that fits best for its number of parameters."""
    changes, read = _logs(exchanges)
    insides = []
    for drum in sorted(read):
        tried = []
        for kind in ("single", "oil", "clutch", "spring"):
            cost, p = _fitted(kind, changes[drum], read[drum])
            tried.append((2 * cost + 6 * len(BOUNDS[kind]), kind, p))
            if cost < 0.6 * np.sum(np.abs(read[drum][:, 1]) < CATCH):
                break
        insides.append(min(tried, key=lambda entry: entry[0])[1:])
    return _predict(insides)


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


def solve(task):
    """Scale first; then to and fro with the full torque; then a slow drift through most of the room."""
    log = []
    drums = [f"object_{number}" for number in range(1, 6)]
    calls = [call("find_objects"), *_turn(drums, TORQUE), call("step", duration=FIRST_S), *_turn(drums, -TORQUE)]
    calls += [call("step", duration=FIRST_S), *_turn(drums, 0.0), *_look(drums, [0.005])]
    log += zip(calls, (yield calls), strict=True)
    moved = [max(abs(reading["angle"]), 0.03) for _, reading in log[-5:]]
    # Half of the time the torque speeds up and half it brakes: the way is a t².
    beat = FIRST_S * math.sqrt(REACH / max(moved))
    calls = [*_turn(drums, TORQUE), *_look(drums, [beat / 2, beat / 2]), *_turn(drums, -TORQUE)]
    calls += [*_look(drums, [beat / 2, beat, beat / 2]), *_turn(drums, TORQUE), *_look(drums, [beat])]
    calls += [*_turn(drums, 0.0), *(call("get_velocity", object_id=drum) for drum in drums)]
    log += zip(calls, (yield calls), strict=True)
    spins = [reading["angular_velocity"] for _, reading in log[-5:]]
    angles = [_logs(log)[1][drum][-1, 1] for drum in drums]
    calls = []
    for drum, way, spin, angle in zip(drums, moved, spins, angles, strict=True):
        wanted = -math.copysign((DRIFT + abs(angle)) / DRIFT_S, angle)
        kick = (wanted - spin) / (way / FIRST_S**2) / KICK_S * TORQUE
        calls += _turn([drum], max(-TORQUE, min(TORQUE, kick)))
    calls += [
        call("step", duration=KICK_S),
        *_turn(drums, 0.0),
        *_look(drums, DRIFT_S * np.array([0.05, 0.1, 0.2, 0.25, 0.3, 0.3, 0.3])),
    ]
    log += zip(calls, (yield calls), strict=True)
    yield [answer(_guess(log))]


def theory(knobs):
    """The strong pulse on each drum, by the motion of shell and core."""
    insides = []
    for number, place in enumerate(knobs["contents"], 1):
        shell, core, rub = (knobs[f"{part}_{number}"] for part in ("shell", "core", "bearing"))
        kind = _model(KINDS[place])
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
    engine = engine.changed(without=("custom",))
    drums = [f"object_{number}" for number in range(1, 6)]
    for drum in drums:
        engine.push(drum, torque=np.array([0, 0, STRONG]))
    engine.step(engine.whole_steps(PULSE_S))
    ways = [engine.turn(drum).angle for drum in drums]
    for drum in drums:
        engine.push(drum, torque=np.zeros(3))
    engine.step(engine.whole_steps(LATER_S))
    spins = [engine.turn(drum).spin for drum in drums]
    return _pick(ways, spins)


def structure(knobs):
    """What each drum holds."""
    return ", ".join(KINDS[place] for place in knobs["contents"])


def naive(knobs):
    """Every core taken as firmly joined."""
    pairs = []
    for number, place in enumerate(knobs["contents"], 1):
        core = knobs[f"core_{number}"] if KINDS[place] in {"oil", "spring", "clutch"} else 0.0
        pairs.append((knobs[f"shell_{number}"] + core, knobs[f"bearing_{number}"]))
    return {"joined": _predict([("single", pair) for pair in pairs])}


def batch(task):
    """A fixed swing with the full torque and a fixed weak pulse, both small enough for the catches."""
    drums = [f"object_{number}" for number in range(1, 6)]
    calls = [call("find_objects"), *_turn(drums, TORQUE), *_look(drums, [0.3]), *_turn(drums, -TORQUE)]
    calls += [*_look(drums, [0.3]), *_turn(drums, -0.1), call("step", duration=0.2), *_turn(drums, 0.0)]
    calls += _look(drums, [0.5, 2.0, 6.0, 20.0])
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
    far = int(np.argmax(np.abs(angles))) + 1
    yield [answer([far, angles[far - 1], far, angles[far - 1] / LATER_S])]
