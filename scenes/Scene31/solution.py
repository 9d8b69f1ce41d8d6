"""Scene 31: trains of pulses at three time scales give the drum's response, and this the parts that answer both."""

from itertools import product
from math import exp, log

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

HOOK, STRONGEST, TICK_S = 1.0, 1.5, 0.005
SIGMA = 0.003
"""Error of a reading in rad or rad/s: rounding to 0.01."""
BIG_NM, BIG_S, SPUN, HELD_S = 60.0, 0.5, 5.0, 0.5
SHARE = (0.5, 2.5)
RANGES = {
    "one": (SHARE, (0.4, 7.0)),
    "two": (SHARE, (0.2, 0.9), SHARE, (2.0, 16.0)),
    "clutch": (SHARE, (0.3, 1.0)),
    "spring": (SHARE, (1.0, 9.0), (0.02, 0.15)),
}
"""Ranges besides the drum's inertia: that of each rotor over it, and the time of its oil in s; torque on the drum at
which a clutch slips in N·m; or the frequency of the spring in rad/s and its damping ratio."""
SHELL = (0.005, 5.0)
GUESSES = {
    "one": ([1.0, tau] for tau in (0.5, 1.5, 5)),
    "two": ([1.0, fast, 1.0, slow] for fast, slow in product((0.3, 0.7), (4, 10))),
    "clutch": ([share, slips] for share, slips in product((0.7, 1.6), (0.4, 0.6, 0.85))),
    "spring": ([1.0, swing, 0.06] for swing in (1.2, 2, 3, 4.5, 6.5)),
}
GUESSES = {kind: list(found) for kind, found in GUESSES.items()}
LOOKS = {
    0.4: (0.02, 0.07, 0.14, 0.22, 0.32),
    2.5: (0.1, 0.3, 0.6, 1.0, 1.5, 2.0),
    12.0: (2.0, 5.0, 8.0, 11.0),
}
"""Time between the pulses of a train, in s, and when to look after each pulse."""


def _matrix(kind, p):
    """Rates of the state: spin of the drum, spins of the rotors, and the twist of the spring if there is one."""
    shell, rotor = p[0], p[1]
    if kind == "one":
        return np.array([[-p[2] / shell, p[2] / shell], [p[2] / rotor, -p[2] / rotor]])
    if kind == "two":
        oils = p[2] / shell, p[4] / shell
        return np.array(
            [
                [-oils[0] - oils[1], oils[0], oils[1]],
                [p[2] / rotor, -p[2] / rotor, 0],
                [p[4] / p[3], 0, -p[4] / p[3]],
            ]
        )
    k, d = p[2], p[3]
    return np.array([[-d / shell, d / shell, -k / shell], [d / rotor, -d / rotor, k / rotor], [1, -1, 0]])


def _linear(kind, p, switches, times):
    """Angle and spin at the times, as the sum of the answers to each change of the torque."""
    rates, modes = np.linalg.eig(_matrix(kind, p))
    first = np.zeros(len(rates))
    first[0] = 1 / p[0]
    weights = modes[0] * np.linalg.solve(modes, first)
    starts, torques = np.array([s for s, _ in switches]), np.array([t for _, t in switches])
    changes = np.diff(np.concatenate(([0.0], torques)))
    since = np.clip(np.asarray(times)[:, None] - starts, 0.0, None)
    spin, angle = np.zeros(since.shape, complex), np.zeros(since.shape, complex)
    for rate, weight in zip(rates, weights, strict=True):
        if abs(rate) < 1e-7:
            spin, angle = spin + weight * since, angle + weight * since**2 / 2
        else:
            grown = np.expm1(rate * since) / rate
            spin, angle = spin + weight * grown, angle + weight * (grown - since) / rate
    return (angle @ changes).real, (spin @ changes).real


def _slipping(p, switches, times):
    """Angle and spin at the times with a clutch that slips beyond its torque."""
    shell, rotor, limit = p[0], p[1], p[2]
    starts = [s for s, _ in switches]
    now = angle = drum = inner = torque = 0.0
    found, upcoming = [], 0
    for time, reading in sorted([(s, 0) for s in starts] + [(t, 1) for t in times]):
        left = time - now
        while left > 1e-12:
            gap = drum - inner
            if abs(gap) < 1e-12 and abs(torque) * rotor / (shell + rotor) <= limit:
                rate = both = torque / (shell + rotor)
                span = left
            else:
                pull = limit * np.sign(gap if abs(gap) >= 1e-12 else torque)
                rate, both = (torque - pull) / shell, pull / rotor
                closing = (both - rate) * np.sign(gap)
                span = min(left, abs(gap) / closing) if abs(gap) >= 1e-12 and closing > 0 else left
            angle += drum * span + rate * span**2 / 2
            drum, inner, left = drum + rate * span, inner + both * span, left - span
            if abs(drum - inner) < 1e-10:
                inner = drum
        now = time
        if reading:
            found.append((angle, drum))
        else:
            torque = switches[upcoming][1]
            upcoming += 1
    return np.array([f[0] for f in found]), np.array([f[1] for f in found])


def _motion(kind, p, switches, times):
    return _slipping(p, switches, times) if kind == "clutch" else _linear(kind, p, switches, times)


def _record(readings):
    """When which torque began, and when which angle and spin were read, as far as the hook did not act."""
    switches, looks, now = [], [], 0.0
    for asked, got in readings:
        if asked.tool == "apply_torque":
            switches.append((now, asked.arguments["torque_vector"][2]))
        elif asked.tool == "get_position":
            looks.append((now, 0, got["angle"]))
        elif asked.tool == "get_velocity":
            looks.append((now, 1, got["angular_velocity"]))
        now = got["sim_time"]
    beyond = [when for when, which, value in looks if which == 0 and abs(value) > HOOK]
    kept = [look for look in looks if not beyond or look[0] < beyond[0]]
    times = sorted({when for when, _, _ in kept})
    rows = [times.index(when) for when, _, _ in kept]
    return switches, times, rows, [which for _, which, _ in kept], np.array([value for _, _, value in kept])


def _parts(kind, constants):
    """Inertias and torques of a drum from the constants of RANGES, that of the drum before them."""
    shell, share, *rest = constants
    rotor = share * shell
    if kind == "one":
        return [shell, rotor, rotor / rest[0]]
    if kind == "two":
        return [shell, rotor, rotor / rest[0], rest[1] * shell, rest[1] * shell / rest[2]]
    if kind == "clutch":
        return [shell, rotor, rest[0] * share / (1 + share)]
    return [shell, rotor, rotor * rest[0] ** 2, 2 * rest[1] * rest[0] * rotor]


def _misfits(kind, record):
    """Logarithms of the constants → misfits of the readings, in their errors."""
    switches, times, rows, which, values = record

    def misfits(logs):
        motion = np.array(_motion(kind, _parts(kind, np.exp(logs)), switches, times))
        return np.nan_to_num(motion[which, rows] - values, nan=1e3) / SIGMA

    return misfits


def _fitted(kind, record):
    """Half the sum of squares and the logarithms of the constants that fit best."""
    switches, _, _, which, values = record
    misfits, edges = _misfits(kind, record), np.log([SHELL, *RANGES[kind]]).T
    moving = [abs(v) for v, spin in zip(values, which, strict=True) if spin and abs(v) > SIGMA]
    size = min(max(abs(switches[0][1]) * 0.05 / moving[0], 0.05), 3.0) if moving else 0.3
    best = None
    for guess in GUESSES[kind]:
        start = np.log([size, *guess])
        got = least_squares(misfits, start, bounds=edges, x_scale=0.3, max_nfev=8, loss="soft_l1")
        best = got if best is None or got.cost < best.cost else best
    best = least_squares(misfits, best.x, bounds=edges, x_scale=0.3, max_nfev=60, loss="soft_l1")
    return best.cost, best.x


def _best(record):
    """The structure with the best fit, a parameter counting as much as a few readings, and its parameters."""
    fits = {kind: _fitted(kind, record) for kind in RANGES}
    kind = min(fits, key=lambda name: fits[name][0] + len(RANGES[name]) * log(len(record[4])) / 2)
    return kind, _parts(kind, np.exp(fits[kind][1]))


def _predict(kind, p):
    """Spin after the big torque; spin in the end after a hold."""
    total = p[0] + p[1] + (p[3] if kind == "two" else 0)
    spin = float(_motion(kind, p, [(0.0, BIG_NM)], [BIG_S])[1][0])
    if kind == "clutch":
        left = max(0.0, SPUN * p[1] - p[2] * HELD_S)
    elif kind == "spring":
        turned = expm(np.array([[-p[3] / p[1], p[2] / p[1]], [-1, 0]]) * HELD_S)
        left = p[1] * float(turned[0, 0]) * SPUN
    else:
        left = sum(p[n] * SPUN * exp(-p[n + 1] * HELD_S / p[n]) for n in range(1, len(p), 2))
    return [spin, float(left / total)]


def _turn(torque):
    return call("apply_torque", object_id="object_1", torque_vector=[0, 0, float(f"{torque:.6g}")])


def _look(spin):
    both = [call("get_position", object_id="object_1")]
    return [*both, call("get_velocity", object_id="object_1")] if spin else both


def _train(wait, short, torque, spins):
    """A pulse, a double pulse back, and a pulse: what only follows the torque comes back to its place."""
    calls = []
    for sign, length in ((1, short), (-1, 2 * short), (1, short)):
        calls += [_turn(sign * torque), call("step", duration=length), _turn(0)]
        before = 0.0
        for moment in LOOKS[wait]:
            calls += [call("step", duration=round(moment - before, 3)), *_look(spins)]
            before = moment
    return calls


def _excursion(model, switches, now, wait, short, torque):
    """How far the drum goes in a train, by the model."""
    kind, p = model
    planned, then = list(switches), now
    for sign, length in ((1, short), (-1, 2 * short), (1, short)):
        planned += [(then, sign * torque), (then + length, 0.0)]
        then += length + LOOKS[wait][-1]
    return float(np.max(np.abs(_motion(kind, p, planned, list(np.linspace(now, then, 40)))[0])))


def solve(task):
    """Pulses until the drum moves visibly, then trains of which the model so far says how strong they may be."""
    seen, model = [], None
    for length in (0.01, 0.08):
        calls = [_turn(STRONGEST), call("step", duration=length), _turn(0), call("step", duration=0.05), *_look(True)]
        seen += zip(calls, (yield calls), strict=True)
        spin = abs(seen[-1][1]["angular_velocity"])
        if spin > 0.25:
            break
    calls = [_turn(-STRONGEST), call("step", duration=sum((0.01, 0.08)[: len(seen) // 6])), _turn(0), *_look(True)]
    seen += zip(calls, (yield calls), strict=True)
    for wait in LOOKS:
        record = _record(seen)
        model = _best(record)
        now, short, torque = seen[-1][1]["sim_time"], 0.2 * wait, STRONGEST
        while _excursion(model, record[0], now, wait, short, torque) > 0.6 * HOOK and torque > 1e-3:
            if short > 0.03:
                short = round(0.85 * short / TICK_S) * TICK_S
            else:
                torque *= 0.9
        calls = _train(wait, round(short, 3), torque, wait < 1)
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*_best(_record(seen))))]


def fit(readings, structure):
    """Both spins by the model of a structure."""
    return _predict(structure, _parts(structure, np.exp(_fitted(structure, _record(readings))[1])))


def rivals(readings):
    """Every kind of drum, fitted."""
    record, found = _record(readings), {}
    for kind, ranges in RANGES.items():
        misfits, edges = _misfits(kind, record), np.log([SHELL, *ranges])
        best = least_squares(misfits, _fitted(kind, record)[1], bounds=edges.T, x_scale=0.3, max_nfev=60).x
        edges[0] = best[0] - 0.5, best[0] + 0.5
        found[kind] = member(
            misfits, lambda logs, kind=kind: _predict(kind, _parts(kind, np.exp(logs))), best, edges.tolist()
        )
    return found


def _true(knobs):
    names = {"one": (), "two": ("rotor2", "oil2"), "clutch": (), "spring": ("damping",)}[knobs["kind"]]
    third = {"one": "damping", "two": "damping", "clutch": "limit", "spring": "stiffness"}[knobs["kind"]]
    return np.array([knobs[name] for name in ("shell", "rotor", third, *names)])


def naive(knobs):
    """All turns as one; the drum turns alone; the clutch or oil holds like a rigid joint at first."""
    p = _true(knobs)
    total = p[0] + p[1] + (p[3] if knobs["kind"] == "two" else 0)
    push = BIG_NM * BIG_S
    inner = SPUN * (1 - p[0] / total)
    return {"rigid": [push / total, inner], "nothing lost while held": [push / p[0], inner]}


def stage(task):
    """The strongest torque for as long as it takes to give the same push."""
    calls = [_turn(STRONGEST), call("step", duration=BIG_NM * BIG_S / STRONGEST), *_look(True)]
    readings = yield calls
    yield [answer([readings[-1]["angular_velocity"], 0.0])]


def batch(task):
    """Three trains, each stronger and longer than the one before, planned without a look."""
    calls = []
    for torque, length, looks in ((0.75, 0.02, (0.1, 0.2)), (1.2, 0.1, (0.2, 0.6)), (1.0, 0.4, (0.6, 3, 8))):
        for sign, factor in ((1, 1), (-1, 2)):
            calls += [_turn(sign * torque), call("step", duration=factor * length), _turn(0)]
            before = 0.0
            for moment in looks:
                calls += [call("step", duration=round(moment - before, 3)), *_look(moment < 0.5)]
                before = moment
    readings = yield calls
    seen = list(zip(calls, readings, strict=True))
    yield [answer(_predict(*_best(_record(seen))))]


def theory(knobs):
    """Linear motion by its modes; a slipping clutch piece by piece."""
    return _predict(knobs["kind"], _true(knobs))


def measure(engine, knobs):
    """Without the hook: the big torque; then spun up, stopped by whatever torque it takes, held and let go.

    The stop takes one step, so the hold is half a step too short, and with one more step half a step too long.
    """
    free = engine.changed({"body[hook].pos": (0.0, 0.0, 0.0)})
    step = 1 / free.whole_steps(1.0)
    calm = {
        "one": 8 * knobs["tau1"],
        "two": 6 * knobs["ratio"] * knobs["tau1"],
        "clutch": 40.0,
        "spring": 5 / (knobs["loss"] * knobs["swing"]),
    }[knobs["kind"]]
    free.push("object_1", torque=np.array([0.0, 0.0, BIG_NM]))
    free.step(free.whole_steps(BIG_S))
    first = float(free.twist("object_1").angular[2])
    free = engine.changed({"body[hook].pos": (0.0, 0.0, 0.0)})
    p = _true(knobs)
    total = p[0] + p[1] + (p[3] if knobs["kind"] == "two" else 0)
    free.push("object_1", torque=np.array([0.0, 0.0, SPUN * total / 2]))
    free.step(free.whole_steps(2.0))
    free.push("object_1", torque=np.zeros(3))
    free.step(free.whole_steps(calm))
    start, ends = free.save(), []
    for steps in (free.whole_steps(HELD_S), free.whole_steps(HELD_S) + 1):
        free.restore(start)
        before, brake = float(free.twist("object_1").angular[2]), 0.0
        for _ in range(steps):
            spin = float(free.twist("object_1").angular[2])
            drawn = knobs["shell"] * (spin - before) / step - brake
            before, brake = spin, -knobs["shell"] * spin / step - drawn
            free.push("object_1", torque=np.array([0.0, 0.0, brake]))
            free.step(1)
        free.push("object_1", torque=np.zeros(3))
        free.step(free.whole_steps(calm))
        ends.append(float(free.twist("object_1").angular[2]))
    return [first, (ends[0] + ends[1]) / 2]
