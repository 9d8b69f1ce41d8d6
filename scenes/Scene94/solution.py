"""Scene 94: let the pan swing under a load and without it, fit what goes along, calculate the force of the shaker."""

from math import pi

import numpy as np

from scenes.courses import refined
from scenes.protocol import answer, call

GRAVITY, TOP, CATCH = 9.81, 2.0, 0.3
PERIOD_S, SWING = 0.4, 0.5
RADIUS, SIGMA = 0.06, 0.0012
STRUCTURES = {
    "spring": ("k", "own", "part", "inner", "zeta"),
    "oil": ("k", "own", "part", "rate"),
    "arm": ("k", "own", "more", "gives"),
}
BOX = {
    "own": (3.0, 8.0),
    "part": (0.1, 0.7),
    "inner": (3.0, 8.0),
    "zeta": (0.01, 0.15),
    "rate": (1.0, 20.0),
    "more": (0.4, 5.0),
    "gives": (0.05, 1.0),
}
"""Ranges; that of the stiffness `k` follows from the readings."""
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.0006, 8.0, 0.015, 0.5
LOOK_S, SINK = 0.12, 0.065
STARTS, TRIED, ROUNDS, WORTH = 300, 4, 25, 4.0


def _motion(structure, knobs, load):
    """Matrix of the laws for sink and speed of the pan, place and speed of what goes along, and a 1; one per trial."""
    k, own = np.asarray(knobs["k"]), np.asarray(knobs["own"])
    total, laws = k / own**2, np.zeros((k.size, 5, 5))
    laws[:, 0, 1] = 1.0
    if structure == "arm":
        heavy, arm = total + load, knobs["more"] * k
        laws[:, 1, 0], laws[:, 1, 2] = -(k + arm) / heavy, arm / heavy
        laws[:, 2, 0], laws[:, 2, 2] = 1 / knobs["gives"], -1 / knobs["gives"]
    else:
        weight = total * knobs["part"]
        heavy = total - weight + load
        laws[:, 2, 3] = 1.0
        if structure == "spring":
            stiff = knobs["inner"] ** 2
            laws[:, 1, 0], laws[:, 1, 2] = -(k + weight * stiff) / heavy, weight * stiff / heavy
            laws[:, 1, 1] = -2 * knobs["zeta"] * own * total / heavy
            laws[:, 3, 0], laws[:, 3, 2] = stiff, -stiff
        else:
            rate = knobs["rate"]
            laws[:, 1, 0], laws[:, 1, 1], laws[:, 1, 3] = -k / heavy, -weight * rate / heavy, weight * rate / heavy
            laws[:, 3, 1], laws[:, 3, 3] = rate, -rate
    laws[:, 1, 4] = load * GRAVITY / heavy
    return laws, heavy - load


def _flow(laws, span):
    """Exponentials of the matrices."""
    small, found = laws * (span / 64), np.eye(5) + np.zeros_like(laws)
    for order in range(6, 0, -1):
        found = np.eye(5) + small @ found / order
    for _ in range(6):
        found = found @ found
    return found


def _legs(exchanges):
    """Of each step: its length, the load, the load that came at rest at its beginning, and the sink that was read."""
    made, load, came, legs = {}, 0.0, 0.0, []
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            came = made[asked.arguments["object1_id"]]
            load += came
        elif asked.tool == "delete_objects":
            load -= made[asked.arguments["object_id"]]
        elif asked.tool == "step":
            legs.append([asked.arguments["duration"], round(load, 9), came, np.nan])
            came = 0.0
        elif asked.tool == "get_position" and legs:
            legs[-1][3] = TOP - reading["position"][2]
            if legs[-1][3] > CATCH - 0.003:
                return legs[:-1] or [[1.0, 1.0, 1.0, 0.1]]
    return legs


def _knobs(structure, stiffness, units):
    """Constants at points of the unit cube."""
    box = {**BOX, "k": (stiffness / 3, stiffness * 3)}
    return {
        name: box[name][0] * (box[name][1] / box[name][0]) ** unit
        for name, unit in zip(STRUCTURES[structure], units, strict=True)
    }


def _misfits(legs, structure, stiffness, units):
    """Misfits of all readings, and a weak pull to the middle; a column for each trial."""
    knobs, flows, found = _knobs(structure, stiffness, units), {}, []
    state = np.zeros((units.shape[1], 5))
    state[:, 4] = 1.0
    for span, load, came, sink in legs:
        if (span, load) not in flows:
            laws, bare = _motion(structure, knobs, load)
            flows[span, load] = _flow(laws, span), bare
        flow, bare = flows[span, load]
        state[:, 1] *= (bare + load - came) / (bare + load)
        state = (flow @ state[:, :, None])[:, :, 0]
        if not np.isnan(sink):
            found.append(np.clip((state[:, 0] - sink) / SIGMA, -1e4, 1e4))
    return np.vstack([*found, 0.3 * (units - 0.5)])


def _fitted(legs, structure):
    """Chi-square and constants of the best fit of a structure."""
    deepest = max(legs, key=lambda leg: np.nan_to_num(leg[3]))
    stiffness = deepest[1] * GRAVITY * 1.5 / max(np.nan_to_num(deepest[3]), 0.001) or 1.0

    def misfits(units):
        return _misfits(legs, structure, stiffness, units)

    starts = np.random.default_rng(0).random((len(STRUCTURES[structure]), STARTS))
    order = np.argsort(np.log1p(misfits(starts) ** 2).sum(axis=0))[:TRIED]
    units = [refined(misfits, starts[:, start], ROUNDS) for start in order]
    costs = [float((misfits(unit[:, None]) ** 2).sum()) for unit in units]
    best = int(np.argmin(costs))
    return costs[best], {name: float(value) for name, value in _knobs(structure, stiffness, units[best]).items()}


def _best(legs):
    """The structure that fits best, each constant paid for, and its constants."""
    fits = {structure: _fitted(legs, structure) for structure in STRUCTURES}
    structure = min(fits, key=lambda name: fits[name][0] + WORTH * len(STRUCTURES[name]))
    return structure, fits[structure][1]


def _force(structure, knobs):
    """Force of the shaker: of the springs, and of all masses, each with the part and the phase of its motion."""
    laws, bare = _motion(structure, {name: np.array([knobs[name]]) for name in STRUCTURES[structure]}, 0.0)
    matrix, turn = laws[0, :4, :4], 2 * pi / PERIOD_S
    used = [0, 1, 2] if structure == "arm" else [0, 1, 2, 3]
    answers = np.linalg.solve(
        1j * turn * np.eye(len(used)) - matrix[np.ix_(used, used)], np.eye(len(used))[:, 1] / float(bare[0])
    )
    return float(SWING / abs(answers[0]))


def fit(readings, structure):
    """The force by the laws of a structure."""
    return _force(structure, _fitted(_legs(readings), structure)[1])


def structure(knobs):
    """What goes along with the pan."""
    return knobs["kind"]


def theory(knobs):
    """The force by the drawn laws."""
    return _force(knobs["kind"], {**knobs, "k": knobs["total"] * knobs["own"] ** 2})


def naive(knobs):
    """All as a single body on the springs that bear it; the springs alone."""
    turn = 2 * pi / PERIOD_S
    return {
        "single body": SWING * knobs["total"] * abs(knobs["own"] ** 2 - turn**2),
        "springs alone": SWING * knobs["total"] * knobs["own"] ** 2,
    }


def _looks(number, span=LOOK_S):
    return [call("step", duration=span), call("get_position", object_id="object_1")] * number


def _unload(number):
    return [call("delete_objects", object_id=f"b{number}")]


def _load(number, kg):
    """A ball of this mass on the pan."""
    density, where = kg / (4 / 3 * pi * RADIUS**3), [0.0, 0.3 * (number % 2) - 0.15, TOP]
    name = f"b{number}"
    made = call("create_objects", name=name, pos=where, density=density, rgba=[1, 0, 0, 1], radius=RADIUS)
    return [made, call("attach_objects", object1_id=name, object2_id="object_1")]


def _ladder():
    """Heavier and heavier balls until the pan sinks visibly; returns what was seen, the last number and its mass."""
    seen, number, kg = [], 0, FIRST_KG
    while True:
        calls = [*(_unload(number - 1) if number else []), *_load(number, kg), *_looks(1, SETTLE_S)]
        seen += zip(calls, (yield calls), strict=True)
        sink = _legs(seen)[-1][3]
        if sink > SEEN or number > 6:
            return seen, number, kg * 0.05 * 1.7 / max(sink, 0.003)
        number, kg = number + 1, GROWTH * kg


def solve(task):
    """Find the scale, then swing with a load and without it, as wide as the catch allows."""
    seen, number, kg = yield from _ladder()
    calls = [*_unload(number), *_load(number + 1, kg), *_looks(6)]
    seen += zip(calls, (yield calls), strict=True)
    calls = [*_unload(number + 1), *_looks(6)]
    seen += zip(calls, (yield calls), strict=True)
    for ball in (number + 2, number + 3):
        kg = SINK * _best(_legs(seen))[1]["k"] / GRAVITY
        for calls in ([*_load(ball, kg), *_looks(9)], [*_unload(ball), *_looks(12)]):
            seen += zip(calls, (yield calls), strict=True)
    yield [answer(_force(*_best(_legs(seen))))]


def batch(task):
    """Balls in even ratios, each on for a few looks and off for one, and the same fit."""
    calls = []
    for rung in range(5):
        calls += [*_load(rung, 0.0008 * 10.0**rung), *_looks(3, 0.25), *_unload(rung), *_looks(1, 0.25)]
    legs = _legs(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_force(*_best(legs)))]


def stage(task):
    """Shake it with a ball that is put on and taken off, and carry the swing on in proportion."""
    _, number, kg = yield from _ladder()
    calls = _unload(number)
    for turn in range(number + 1, number + 19):
        half = [call("step", duration=PERIOD_S / 2)]
        if turn > number + 14:
            half = [*_looks(1, PERIOD_S / 4), call("step", duration=PERIOD_S / 4)]
        calls += [*_load(turn, 0.7 * kg), *half, *_unload(turn), *half]
    readings = yield calls
    places = [reading["position"][2] for reading in readings if "position" in reading]
    swing = abs(np.mean(places[::2]) - np.mean(places[1::2])) / 2
    yield [answer(float(2 / pi * 0.7 * kg * GRAVITY * SWING / max(swing, 1e-4)))]


def measure(engine, knobs):
    """The swing in the engine without the catch, begun as the theory says, over some periods."""
    force, turn, kind = theory(knobs), 2 * pi / PERIOD_S, knobs["kind"]
    laws, bare = _motion(kind, {**knobs, "k": np.array([knobs["total"] * knobs["own"] ** 2])}, 0.0)
    used = [0, 1, 2] if kind == "arm" else [0, 1, 2, 3]
    pushed = np.eye(len(used))[:, 1] * force / float(bare[0])
    wave = np.linalg.solve(1j * turn * np.eye(len(used)) - laws[0][np.ix_(used, used)], pushed)
    places, speeds = wave.imag, (1j * turn * wave).imag
    inner, end = (places[0], places[2]) if kind == "arm" else (places[2], 0.0)
    inner_speed = speeds[0] if kind == "arm" else speeds[2]
    free = engine.changed(
        {
            "joint[guide].range": (-50.0, 50.0),
            "body[guard].pos": (0.0, 0.0, -50.0),
            "key[start].qpos": (float(places[0]), float(inner - places[0]), float(end), 0.0),
            "key[start].qvel": (float(speeds[0]), float(inner_speed - speeds[0]), 0.0, 0.0),
        }
    )
    step, sinks = 1 / free.whole_steps(1.0), []
    for number in range(free.whole_steps(8 * PERIOD_S)):
        free.push("object_1", force=np.array([0.0, 0.0, -force * np.sin(turn * (number + 0.5) * step)]))
        free.step(1)
        sinks.append(TOP - float(free.pose("object_1").position[2]))
    times = step * np.arange(1, len(sinks) + 1)
    swing = 2 * abs(np.mean(np.array(sinks) * np.exp(-1j * turn * times)))
    return float(force * SWING / swing)
