"""Scene 94: find the scale, sink deep enough to hook what is unseen, fit the swings, calculate the shaker's force."""

from math import pi

import numpy as np

from scenes.courses import refined
from scenes.family import member
from scenes.loads import GRAVITY, ball, hung, joined, looks
from scenes.protocol import answer, call

PAN, TOP, CATCH = "object_1", 2.0, 0.3
PERIOD_S, SWING = 0.5, 0.5
RADIUS, SIGMA = 0.06, 0.0016
COMMON = ("k", "own", "zeta", "edge")
STRUCTURES = {
    "spring": (*COMMON, "part", "inner"),
    "oil": (*COMMON, "part", "rate"),
    "arm": (*COMMON, "more", "gives"),
}
BOX = {
    "own": (3.0, 8.0),
    "zeta": (0.01, 0.2),
    "edge": (0.13, 0.2),
    "part": (0.4, 1.6),
    "inner": (3.0, 9.0),
    "rate": (1.0, 20.0),
    "more": (0.4, 2.5),
    "gives": (0.05, 1.0),
}
"""Ranges; that of the stiffness `k` follows from the readings."""
FIRST_KG, GROWTH, SEEN, SETTLE_S = 4e-5, 8.0, 0.015, 0.5
LOOK_S, DEEPEST, FINE_S = 0.12, 0.255, 0.04
"""Time between looks, sink that is aimed at, and longest step in which the hook is looked for."""
STARTS, TRIED, ROUNDS, PARTS = 200, 4, 20, (0.4, 0.62, 1.0)


def _motion(structure, knobs, load, hooked):
    """Matrix of the laws for sink and speed of the pan, place and speed of what is hooked, and a 1; one per trial."""
    k, own = np.asarray(knobs["k"]), np.asarray(knobs["own"])
    bare, laws = k / own**2, np.zeros((k.size, 5, 5))
    heavy = bare + load
    laws[:, 0, 1] = 1.0
    laws[:, 1, 0], laws[:, 1, 1], laws[:, 1, 4] = (
        -k / heavy,
        -2 * knobs["zeta"] * k / own / heavy,
        load * GRAVITY / heavy,
    )
    if not hooked:
        return laws
    if structure == "arm":
        stretched = np.stack([np.ones_like(k), 0 * k, -np.ones_like(k), 0 * k, -knobs["edge"] + 0 * k], axis=1)
        laws[:, 1] -= (knobs["more"] * k / heavy)[:, None] * stretched
        laws[:, 2] = stretched / np.asarray(knobs["gives"])[..., None]
        return laws
    stiff, rate = (knobs["inner"] ** 2, 0 * k) if structure == "spring" else (0 * k, knobs["rate"] + 0 * k)
    pull = np.stack([stiff, rate, -stiff, -rate, -stiff * knobs["edge"]], axis=1)
    laws[:, 1] -= (bare * knobs["part"] / heavy)[:, None] * pull
    laws[:, 2, 3], laws[:, 3] = 1.0, pull
    return laws


def _flow(laws, span):
    """Exponentials of the matrices."""
    small, found = laws * (span / 64), np.eye(5) + np.zeros_like(laws)
    for order in range(6, 0, -1):
        found = np.eye(5) + small @ found / order
    for _ in range(6):
        found = found @ found
    return found


def _after(laws, state, time):
    """States after short times, by their series."""
    term = found = state
    for order in range(1, 9):
        term = (laws @ term[:, :, None])[:, :, 0] * time[:, None] / order
        found = found + term
    return found


class _Swing:
    """Trials that swing under loads, each until it hooks what is unseen, and on with it."""

    def __init__(self, structure, knobs, trials):
        self.structure, self.knobs, self.kept = structure, knobs, {}
        self.state, self.hooked = np.zeros((trials, 5)), np.zeros(trials, dtype=bool)
        self.state[:, 4] = 1.0
        self.edge, self.bare = knobs["edge"] + np.zeros(trials), np.asarray(knobs["k"]) / np.asarray(knobs["own"]) ** 2

    def _flows(self, load, span):
        if (load, span) not in self.kept:
            laws = [_motion(self.structure, self.knobs, load, hooked) for hooked in (False, True)]
            self.kept[load, span] = (*laws, *(_flow(one, span) for one in laws))
        return self.kept[load, span]

    def leg(self, span, load, came):
        """The sinks after a time under a load, part of which came at rest at its beginning."""
        self.state[:, 1] *= (self.bare + load - came) / (self.bare + load)
        count = 1 if self.hooked.all() else int(np.ceil(span / FINE_S - 1e-9))
        free, bound, loose, firm = self._flows(load, span / count)
        for _ in range(count):
            flow = np.where(self.hooked[:, None, None], firm, loose)
            before, self.state = self.state, (flow @ self.state[:, :, None])[:, :, 0]
            caught = np.flatnonzero(~self.hooked & (self.state[:, 0] > self.edge))
            if caught.size:
                begun = before[caught]
                time = span / count * (self.edge[caught] - begun[:, 0]) / (self.state[caught, 0] - begun[:, 0])
                for _ in range(2):
                    there = _after(free[caught], begun, time)
                    time = np.clip(
                        time + (self.edge[caught] - there[:, 0]) / np.maximum(there[:, 1], 1e-3), 0, span / count
                    )
                there = _after(free[caught], begun, time)
                self.state[caught] = _after(bound[caught], there, span / count - time)
                self.hooked[caught] = True
        return self.state[:, 0].copy()


def _legs(exchanges):
    """Of each step: its length, the load, the load that came at rest at its beginning, and the sink that was read."""
    legs, before, came = [], 0.0, 0.0
    for asked, reading, on in hung(exchanges):
        if asked.tool == "attach_objects":
            came += on[PAN] - before
        elif asked.tool == "step":
            legs.append([asked.arguments["duration"], round(on[PAN], 10), came, np.nan])
            came = 0.0
        elif asked.tool == "get_position" and legs:
            legs[-1][3] = TOP - reading["position"][2]
            if legs[-1][3] > CATCH - 0.003:
                return legs[:-1] or [[1.0, 1.0, 1.0, 0.1]]
        before = on[PAN]
    return legs


def _knobs(structure, stiffness, units):
    """Constants at points of the unit cube."""
    box = {**BOX, "k": (stiffness / 3, stiffness * 3)}
    return {
        name: box[name][0] * (box[name][1] / box[name][0]) ** unit
        for name, unit in zip(STRUCTURES[structure], units, strict=True)
    }


def _stiffness(legs):
    """Rough stiffness of the springs, from the deepest place under the heaviest load."""
    heaviest = max(leg[1] for leg in legs)
    deepest = max(np.nan_to_num(sink) for _, load, _, sink in legs if load == heaviest)
    return heaviest * GRAVITY * 1.5 / max(deepest, 0.001) or 1.0


def _misfits(legs, structure, units, count=None):
    """Misfits of the readings of all legs, or of the first ones; a column for each trial."""
    swing, found = _Swing(structure, _knobs(structure, _stiffness(legs), units), units.shape[1]), []
    for span, load, came, sink in legs[:count]:
        place = swing.leg(span, load, came)
        if not np.isnan(sink):
            found.append(np.clip((place - sink) / SIGMA, -1e4, 1e4))
    return np.array(found)


def _fitted(legs, structure):
    """Chi-square of the best fit of a structure, and its point of the unit cube: of some legs, of more, then of all."""

    def wrong(share):
        count = round(share * len(legs))
        return lambda units: np.vstack([_misfits(legs, structure, units, count), 0.3 * (units - 0.5)])

    starts = np.random.default_rng(0).random((len(STRUCTURES[structure]), STARTS))
    order = np.argsort(np.log1p(wrong(PARTS[0])(starts) ** 2).sum(axis=0))[:TRIED]
    units = [starts[:, start] for start in order]
    for share in PARTS:
        units = [refined(wrong(share), unit, ROUNDS) for unit in units]
    costs = [float((wrong(1.0)(unit[:, None]) ** 2).sum()) for unit in units]
    best = int(np.argmin(costs))
    return costs[best], units[best]


def _constants(legs, structure, unit):
    """The constants at a point of the unit cube."""
    return {name: float(value) for name, value in _knobs(structure, _stiffness(legs), unit).items()}


def _best(legs):
    """The structure that fits best, and its constants."""
    fits = {structure: _fitted(legs, structure) for structure in STRUCTURES}
    structure = min(fits, key=lambda name: fits[name][0])
    return structure, _constants(legs, structure, fits[structure][1])


def _shaken(structure, knobs):
    """Motion of pan and what is hooked as a complex number per newton of the shaker, and the rate of its phase."""
    laws = _motion(structure, {name: np.array([value]) for name, value in knobs.items()}, 0.0, True)[0]
    used, turn = ([0, 1, 2] if structure == "arm" else [0, 1, 2, 3]), 2 * pi / PERIOD_S
    pushed = np.eye(len(used))[:, 1] * knobs["own"] ** 2 / knobs["k"]
    return np.linalg.solve(1j * turn * np.eye(len(used)) - laws[np.ix_(used, used)], pushed), turn


def predict(structure, knobs):
    """Force of the shaker: of the springs, and of all masses, each with the part and the phase of its motion."""
    known = {name: knobs[name] for name in STRUCTURES[structure]}
    return float(SWING / abs(_shaken(structure, known)[0][0]))


def fit(readings, structure):
    """The force by the laws of a structure."""
    legs = _legs(readings)
    return predict(structure, _constants(legs, structure, _fitted(legs, structure)[1]))


def rivals(readings):
    """Each thing that may be hooked, fitted."""
    legs = _legs(readings)

    def of(structure):
        return member(
            lambda unit: _misfits(legs, structure, unit[:, None])[:, 0],
            lambda unit: predict(structure, _constants(legs, structure, unit)),
            _fitted(legs, structure)[1],
            [(0.0, 1.0)] * len(STRUCTURES[structure]),
        )

    return {structure: of(structure) for structure in STRUCTURES}


def structure(knobs):
    """What the pan hooks."""
    return knobs["kind"]


def theory(knobs):
    """The force by the drawn laws."""
    return predict(knobs["kind"], _true(knobs))


def _true(knobs):
    return {**knobs, "k": knobs["mass"] * knobs["own"] ** 2}


def naive(knobs):
    """The pan alone on the springs that bear it; the springs alone."""
    turn = 2 * pi / PERIOD_S
    return {
        "pan alone": SWING * knobs["mass"] * abs(knobs["own"] ** 2 - turn**2),
        "springs alone": SWING * knobs["mass"] * knobs["own"] ** 2,
    }


def _unload(number):
    return [call("delete_objects", object_id=f"b{number}")]


def _load(number, kg):
    """A ball of this mass on the pan."""
    return joined(ball(f"b{number}", kg, [0.0, 0.3 * (number % 2) - 0.15, TOP], RADIUS), PAN)


def _ladder():
    """Heavier and heavier balls until the pan sinks visibly; what was seen, the last number, and the next mass."""
    seen, number, kg = [], 0, FIRST_KG
    while True:
        calls = [*(_unload(number - 1) if number else []), *_load(number, kg), *looks(PAN, [SETTLE_S])]
        seen += zip(calls, (yield calls), strict=True)
        sink = _legs(seen)[-1][3]
        if sink > SEEN or number > 8:
            return seen, number, kg * 0.05 * 1.7 / max(sink, 0.003)
        number, kg = number + 1, GROWTH * kg


def _swung(legs, structure, knobs, on, off):
    """The largest ball under which the pan stays short of the catch for some looks with it and some without it."""
    known = {name: np.array([value]) for name, value in knobs.items()}
    now = _Swing(structure, known, 1)
    for span, load, came, _ in legs:
        now.leg(span, load, came)
    best, trials = 0.0, knobs["k"] / GRAVITY * np.linspace(0.03, 0.2, 35)
    for kg in trials:
        swing = _Swing(structure, known, 1)
        swing.state, swing.hooked = now.state.copy(), now.hooked.copy()
        loads = [kg] * (2 * on) + [0.0] * (2 * off)
        sinks = [swing.leg(LOOK_S / 2, load, kg if not look else 0.0)[0] for look, load in enumerate(loads)]
        if max(sinks) > DEEPEST:
            break
        best = float(kg)
    return best or float(trials[0])


def solve(task):
    """Find the scale; then swing with a load and without it, as wide as the catch allows."""
    seen, number, kg = yield from _ladder()
    calls = [*_unload(number), *_load(number + 1, kg), *looks(PAN, [LOOK_S] * 5)]
    calls += [*_unload(number + 1), *looks(PAN, [LOOK_S] * 4)]
    seen += zip(calls, (yield calls), strict=True)
    for next_ball in (number + 2, number + 3):
        legs = _legs(seen)
        kg = _swung(legs, *_best(legs), 10, 10)
        calls = [*_load(next_ball, kg), *looks(PAN, [LOOK_S] * 10)]
        calls += [*_unload(next_ball), *looks(PAN, [LOOK_S] * 10)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(predict(*_best(_legs(seen))))]


def batch(task):
    """Balls in even ratios over the whole scale, each on for four looks and off for two, and the same fit."""
    calls = []
    for rung in range(4):
        calls += [*_load(rung, 1e-4 * 47.0**rung), *looks(PAN, [0.15] * 4), *_unload(rung), *looks(PAN, [0.15] * 2)]
    yield [answer(predict(*_best(_legs(list(zip(calls, (yield calls), strict=True))))))]


def stage(task):
    """Shake it with a ball that is put on and taken off, and carry the swing on in proportion."""
    _, number, kg = yield from _ladder()
    calls = _unload(number)
    for turn in range(number + 1, number + 15):
        half = [call("step", duration=PERIOD_S / 2)]
        if turn > number + 10:
            half = [*looks(PAN, [PERIOD_S / 4]), call("step", duration=PERIOD_S / 4)]
        calls += [*_load(turn, 0.7 * kg), *half, *_unload(turn), *half]
    readings = yield calls
    places = [reading["position"][2] for reading in readings if "position" in reading]
    swing = abs(np.mean(places[::2]) - np.mean(places[1::2])) / 2
    yield [answer(float(2 / pi * 0.7 * kg * GRAVITY * SWING / max(swing, 1e-4)))]


def measure(engine, knobs):
    """The swing in the engine without the catch, begun as the theory says, over some periods."""
    force, known = theory(knobs), {name: _true(knobs)[name] for name in STRUCTURES[knobs["kind"]]}
    wave, turn = _shaken(knobs["kind"], known)
    places, speeds = force * wave.imag, force * (1j * turn * wave).imag
    free = engine.changed(
        {
            "joint[guide].range": (-50.0, 50.0),
            "body[guard].pos": (0.0, 0.0, -50.0),
            "key[start].qpos": (float(places[0]), float(places[2] - knobs["edge"]), 0.01, 0.0),
            "key[start].qvel": (float(speeds[0]), float(speeds[2]), 0.0, 0.0),
        },
        without=("tendon",),
    )
    step, sinks = 1 / free.whole_steps(1.0), []
    for number in range(free.whole_steps(8 * PERIOD_S)):
        free.push(PAN, force=np.array([0.0, 0.0, -force * np.sin(turn * (number + 0.5) * step)]))
        free.step(1)
        sinks.append(TOP - float(free.pose(PAN).position[2]))
    times = step * np.arange(1, len(sinks) + 1)
    swing = 2 * abs(np.mean(np.array(sinks) * np.exp(-1j * turn * times)))
    return float(force * SWING / swing)
