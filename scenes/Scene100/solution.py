"""Scene 100: load each knob as far as its latch allows, let go, load again; fit each kind of works."""

from itertools import permutations

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

KINDS = ("slow", "flow", "all", "two", "dry")
KNOBS = [f"object_{number}" for number in range(1, 6)]
STRONG, PUSH_S, REST_S = 50.0, 100.0, 100.0
FORCE, LATCH = 8.0, 0.25
RESOLUTION = 2e-4
FIRST_FORCE, ROOM, BACK, LESS = 1.0, 0.17, 1.3, 0.7
FARTHEST, OPEN = 0.21, 16.0
"""Way to which a planned push may go, in m; what a kind may fit worse than the best one without being excluded."""
RANGES = {
    "slow": [(10, 600), (20, 150)],
    "flow": [(1500, 15000), (0.4, 5), (10, 600)],
    "all": [(1500, 15000), (0.4, 5), (10, 600), (10, 600), (2, 25)],
    "two": [(10, 600), (0.3, 4), (10, 600), (15, 120)],
    "dry": [(10, 600), (0.7, 8), (0.8, 5)],
}
"""Constants of each kind, as the task bounds them; see `_way`."""
SPANS_S = (2.0, 2.0, 2.0, 4.0, 8.0, 16.0)
PULSE_S, BACK_S, ON_S, WEAK = 3.0, (10.0, 27.0), 30.0, 0.4


def _unit(k, time, dry, pushes):
    """Ways of a spring with dashpot and dry friction beside it, at the end of each push: (force, duration)."""
    way, ways = 0.0, []
    for force, span in pushes:
        net = force - k * way
        if abs(net) > dry:
            way += (net - np.sign(net) * dry) / k * -np.expm1(-span / time)
        ways.append(way)
    return np.array(ways)


def _flow(c, least, pushes):
    """Ways of a dashpot that yields to more than the least force."""
    force, span = np.array(pushes).T
    return np.cumsum(np.sign(force) * np.maximum(np.abs(force) - least, 0) * span / c)


def _way(kind, p, pushes):
    """Ways of a knob of a kind at the end of each push."""
    if kind == "slow":
        return _unit(p[0], p[1], 0.0, pushes)
    if kind == "dry":
        return _unit(p[0], p[1], p[2], pushes)
    if kind == "two":
        return _unit(p[0], p[1], 0.0, pushes) + _unit(p[2], p[3], 0.0, pushes)
    elastic = np.array(pushes)[:, 0] / p[2] + _flow(p[0], p[1], pushes)
    return elastic if kind == "flow" else elastic + _unit(p[3], p[4], 0.0, pushes)


def _starts(kind, k):
    """Parameters from which a fit may begin, for a knob of about this stiffness."""
    if kind == "slow":
        return [(k, t) for t in (30, 90)]
    if kind == "dry":
        return [(k, t, f) for t in (1.5, 5) for f in (1.2, 2.5)]
    if kind == "two":
        return [(2 * k, quick, 2 * k, late) for quick in (0.7, 2) for late in (25, 70)]
    flows = [(c, f, 2 * k) for c in (3000, 10000) for f in (1, 2.5)]
    return flows if kind == "flow" else [(*flow, 2 * k, t) for flow in flows for t in (4, 14)]


def _logs(exchanges):
    """Of each knob the pushes between readings, which of them end with a reading, and the ways read."""
    force = dict.fromkeys(KNOBS, 0.0)
    pushes, read = {knob: [] for knob in KNOBS}, {knob: [] for knob in KNOBS}
    for made, reading in exchanges:
        knob = made.arguments.get("object_id")
        if made.tool == "apply_force":
            force[knob] = made.arguments["force_vector"][0]
        elif made.tool == "step":
            for each in KNOBS:
                pushes[each].append((force[each], made.arguments["duration"]))
        elif made.tool == "get_position":
            read[knob].append((len(pushes[knob]) - 1, reading["position"][0]))
    return pushes, {knob: tuple(map(np.array, zip(*read[knob], strict=True))) for knob in KNOBS}


def _misfits(kind, pushes, read):
    """Misfits of a knob as of a kind, as a function of the logarithms. Readings from the latch on do not count."""
    places, ways = read
    caught = np.argmax(np.abs(ways) > LATCH) if (np.abs(ways) > LATCH).any() else len(ways)
    places, ways = places[:caught], ways[:caught]

    def misfits(logs):
        return (_way(kind, np.exp(logs), pushes)[places] - ways) / (RESOLUTION / 3)

    return misfits


def _bounds(kind):
    return np.log(RANGES[kind])


def _fitted(kind, pushes, read):
    """Misfits at their least, the logarithms there, and the function."""
    misfits = _misfits(kind, pushes, read)
    low, high = _bounds(kind).T
    stiffness = max(abs(force) for force, _ in pushes) / max(np.abs(read[1]).max(), 0.01)
    starts = [np.log(start) for k in (stiffness, 2 * stiffness) for start in _starts(kind, k)]
    starts = [np.clip(start, low + 1e-3, high - 1e-3) for start in starts]
    starts.sort(key=lambda logs: float(np.sum(misfits(logs) ** 2)))
    found = [least_squares(misfits, logs, bounds=(low, high), max_nfev=60) for logs in starts[:3]]
    best = min(found, key=lambda fitted: fitted.cost)
    return 2 * float(best.cost), best.x, misfits


def _all_fitted(exchanges):
    """Every knob fitted as of every kind."""
    pushes, read = _logs(exchanges)
    return {
        (number, kind): _fitted(kind, pushes[knob], read[knob]) for number, knob in enumerate(KNOBS) for kind in KINDS
    }


def _joined(kinds, fits):
    """The member of the family in which the knobs are of these kinds."""
    parts = [fits[number, kind] for number, kind in enumerate(kinds)]
    ends = np.cumsum([len(logs) for _, logs, _ in parts])[:-1]

    def misfits(logs):
        return np.concatenate([part[2](own) for part, own in zip(parts, np.split(logs, ends), strict=True)])

    def predict(logs):
        return _predict([(kind, np.exp(own)) for kind, own in zip(kinds, np.split(logs, ends), strict=True)])

    ranges = [tuple(bounds) for kind in kinds for bounds in _bounds(kind)]
    return member(misfits, predict, np.concatenate([logs for _, logs, _ in parts]), ranges)


def rivals(readings):
    """Every order of the five kinds."""
    fits = _all_fitted(readings)
    return {", ".join(kinds): _joined(kinds, fits) for kinds in permutations(KINDS)}


def _predict(works):
    """The answer, from kind and parameters of each knob."""
    ways = [_way(kind, p, [(STRONG, PUSH_S), (0.0, REST_S)]) for kind, p in works]
    return _pick([way[1] for way in ways], ways[1][0])


def _pick(left, pushed):
    far = int(np.argmax(left))
    return [far + 1, float(left[far]), float(pushed)]


def fit(readings, structure):
    """The prediction, with the works of a structure: kinds of the knobs in order."""
    pushes, read = _logs(readings)
    kinds = structure.split(", ")
    return _predict(
        [(kind, np.exp(_fitted(kind, pushes[k], read[k])[1])) for kind, k in zip(kinds, KNOBS, strict=True)]
    )


def _likeliest(fits):
    """The order of kinds that fits best."""
    return min(permutations(KINDS), key=lambda kinds: sum(fits[place][0] for place in enumerate(kinds)))


def _guess(exchanges):
    """The prediction, with the order of kinds that fits best."""
    fits = _all_fitted(exchanges)
    best = _likeliest(fits)
    return _predict([(kind, np.exp(fits[number, kind][1])) for number, kind in enumerate(best)])


def _push(forces, knobs=KNOBS):
    return [call("apply_force", object_id=k, force_vector=[f, 0, 0]) for k, f in zip(knobs, forces, strict=True)]


def _look(spans, knobs=KNOBS):
    """Positions of the knobs after each span."""
    reads = [call("get_position", object_id=knob) for knob in knobs]
    return [made for span in spans for made in (call("step", duration=span), *reads)]


def _plausible(exchanges):
    """Of each knob the kinds that its readings allow, with the constants that fit best."""
    pushes, read = _logs(exchanges)
    return [_allowed(pushes[knob], read[knob]) for knob in KNOBS]


def _allowed(pushes, read):
    """The same for one knob."""
    fits = [(kind, *_fitted(kind, pushes, read)[:2]) for kind in KINDS]
    least = min(cost for _, cost, _ in fits)
    most = least + OPEN * max(1.0, least / len(read[0]))
    return [(kind, np.exp(logs)) for kind, cost, logs in fits if cost < most]


def _strongest(exchanges, sense, span):
    """The greatest force on each knob in a sense with which no kind that its readings allow comes near the latch."""
    pushes, _ = _logs(exchanges)
    return np.array(
        [
            sense * _greatest(pushes[knob], kinds, sense, span)
            for knob, kinds in zip(KNOBS, _plausible(exchanges), strict=True)
        ]
    )


def _greatest(pushes, kinds, sense, span):
    """The same for one knob."""

    def farthest(force):
        return max(sense * float(_way(kind, p, [*pushes, (sense * force, span)])[-1]) for kind, p in kinds)

    return next((force for force in np.linspace(FORCE, 0.0, 33) if farthest(force) < FARTHEST), 0.0)


def _yielding(exchanges):
    """Which knobs have dashpots that yield, by the order of kinds that fits best.

    On the others a pulse tells nothing new, and a quick knob would coast by its inertia, which the fit leaves out.
    """
    return np.array([kind in {"flow", "all"} for kind in _likeliest(_all_fitted(exchanges))])


def _onward(forces, before, ways, earlier, spans):
    """The next forces of the rising ones; `spans` are the last duration and the next."""
    # In proportion to the room that is left in front of the latch, at most twice as much, and no more than the last
    # rise allows: a knob that has broken away goes faster than in proportion.
    onward = forces * np.minimum(ROOM / np.maximum(ways, ROOM / 2), 2.0)
    rise = np.maximum(ways - earlier, 1e-6) / np.maximum(forces - before, 1e-6)
    rise[earlier < 2 * RESOLUTION] *= 3.0
    onward = np.where(forces > before, np.minimum(onward, forces + np.maximum(ROOM - ways, 0.0) / rise), onward)
    # A knob that still goes at an equal force goes on for the next span.
    creep = np.where(forces == before, np.maximum(ways - earlier, 0.0), 0.0) * spans[1] / spans[0]
    return np.minimum(np.minimum(onward, forces * FARTHEST / np.maximum(ways + creep, 1e-6)), FORCE)


def solve(task):
    """Raise the forces knob by knob, hold, let go, pull with less; before and after, pulses as strong as can be."""
    log = []
    forces, before, ways = np.full(5, FIRST_FORCE), np.zeros(5), np.zeros(5)
    for number, span in enumerate(SPANS_S):
        calls = [*([call("find_objects")] if number == 0 else []), *_push(forces), *_look([span])]
        log += zip(calls, (yield calls), strict=True)
        earlier, ways = ways, np.array([abs(reading["position"][0]) for _, reading in log[-5:]])
        held = forces
        if number + 1 < len(SPANS_S):
            forces, before = _onward(forces, before, ways, earlier, SPANS_S[number : number + 2]), forces
    calls = [*_push(np.zeros(5)), *_look([5.0, 15.0])]
    log += zip(calls, (yield calls), strict=True)
    pulse = np.where(_yielding(log), _strongest(log, -1, PULSE_S), 0.0)
    calls = [*_push(pulse), *_look([PULSE_S])]
    log += zip(calls, (yield calls), strict=True)
    # Back with another force than before, so that a flow shows from which force it begins.
    most = -_strongest(log, -1, sum(BACK_S))
    back = np.where(_yielding(log), most, np.where(BACK * held < most, BACK, LESS) * held)
    calls = [*_push(-back), *_look(BACK_S)]
    log += zip(calls, (yield calls), strict=True)
    fits = _all_fitted(log)
    # Of each knob whose dashpot yields, the force from which it does.
    onsets = {n: np.exp(fits[n, kind][1])[1] for n, kind in enumerate(_likeliest(fits)) if kind in {"flow", "all"}}
    pulse = np.where([n in onsets for n in range(5)], _strongest(log, 1, PULSE_S), 0.0)
    calls = [*_push(pulse), *_look([PULSE_S])]
    log += zip(calls, (yield calls), strict=True)
    # A weak flow for long, because strong ones alone do not tell the onset from the resistance.
    most = _strongest(log, 1, ON_S)
    on = [least + WEAK * max(most[n] - least, 0.0) for n, least in onsets.items()]
    on = np.minimum(on, [most[n] for n in onsets])
    knobs = [KNOBS[n] for n in onsets]
    calls = [*_push(on, knobs), call("step", duration=ON_S), *_push([0.0, 0.0], knobs), *_look([5.0, 12.0])]
    log += zip(calls, (yield calls), strict=True)
    yield [answer(_guess(log))]


def theory(knobs):
    """The strong push on each knob."""
    parts = {
        "slow": ("k_slow", "t_slow"),
        "flow": ("c_flow", "f_flow", "k_flow"),
        "all": ("c_all", "f_all", "k_all"),
        "two": ("k_two", "t_quick"),
        "dry": ("k_dry", "t_dry", "f_dry"),
    }
    works = []
    for place in knobs["contents"]:
        kind = KINDS[place]
        p = [knobs[name] for name in parts[kind]]
        p += [knobs["q_all"] * knobs["k_all"], knobs["t_all"]] if kind == "all" else []
        p += [knobs["q_two"] * knobs["k_two"], knobs["t_late"]] if kind == "two" else []
        works.append((kind, p))
    return _predict(works)


def measure(engine, knobs):
    """The engine's own strong push, without the latches."""
    engine = engine.changed(without=("custom",))
    starts = [engine.pose(knob).position[0] for knob in KNOBS]
    for force, span in ((STRONG, PUSH_S), (0.0, REST_S)):
        for knob in KNOBS:
            engine.push(knob, force=np.array([force, 0, 0]))
        engine.step(engine.whole_steps(span))
        ways = [engine.pose(knob).position[0] - start for knob, start in zip(KNOBS, starts, strict=True)]
        if force:
            pushed = ways[1]
    return _pick(ways, pushed)


def structure(knobs):
    """What each rod goes into."""
    return ", ".join(KINDS[place] for place in knobs["contents"])


def naive(knobs):
    """What is left and what is gone, in proportion to a push with 8 N for 10 s."""
    ratio = STRONG / FORCE
    works = theory({**knobs, "f_flow": knobs["f_flow"] * ratio, "f_all": knobs["f_all"] * ratio, "f_dry": 0.0})
    return {"in proportion": works}


def batch(task):
    """One fixed programme of forces that leaves most knobs in front of their latches."""
    calls = [call("find_objects"), *_push(np.full(5, 4.0)), *_look([2.0, 6.0, 12.0])]
    calls += [*_push(np.zeros(5)), *_look([2.0, 8.0, 30.0])]
    log = list(zip(calls, (yield calls), strict=True))
    yield [answer(_guess(log))]


def stage(task):
    """Push every knob with the asked force for the asked time."""
    readings = yield [call("find_objects"), *_push(np.full(5, STRONG)), *_look([PUSH_S])]
    ways = [reading["position"][0] for reading in readings[-5:]]
    yield [answer(_pick(ways, ways[1]))]
