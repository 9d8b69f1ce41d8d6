"""Scene 107: load the pan just beyond the yield of the putty, fit how it sinks, find the force for the big set."""

import numpy as np

from scenes.courses import Laws, Predictor
from scenes.family import members
from scenes.fitting import advanced
from scenes.loads import GRAVITY, Pan
from scenes.protocol import answer

PAN = Pan(top_m=2.0, catch_m=0.2)
PRESSED_S, SET = 10.0, 0.4
COMMON = ("k", "oil", "edge", "tau")
STRUCTURES = {"even": COMMON, "square": COMMON, "hard": (*COMMON, "stiff")}
OWN = "own"
"""Mass of the pan over the stiffness, which delays what is read, and does not matter to the answer [s²]."""
BOX = {"oil": (0.1, 1.0), "edge": (0.09, 0.14), "tau": (2.0, 30.0), "stiff": (1.0, 5.0), OWN: (0.002, 0.02)}
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.002, 4.0, 0.008, 2.0
LOOK_S, LOOKS, STEP, ROOM = 0.8, 3, 0.011, 0.19
CALLS = 119
LONGEST_S = 0.2
"""Longest step in which the answer is integrated."""
LIGHTEST = 0.012
"""Least mass over stiffness in the fit [s²]; a lighter pan is at rest at every look, and would need shorter steps."""
SIGMA = 5e-5
"""Standard deviation of a way that is read and computed, m."""


def _flow(structure, knobs, squeeze, s):
    """Speed at which the putty sinks."""
    over = np.maximum(squeeze - knobs["edge"] - (knobs["stiff"] * s if structure == "hard" else 0.0), 0.0)
    return (over**2 * 20 if structure == "square" else over) / knobs["tau"]


def _rates(structure, knobs, time, state, force):
    """Time derivative of the ways of pan and putty, without inertia."""
    z, s = np.clip(state, -10.0, 10.0)
    squeeze = z - s
    return np.array([(force[0] / knobs["k"] - squeeze) / knobs["oil"], _flow(structure, knobs, squeeze, s)])


def _loaded_rates(structure, knobs, time, state, force):
    """Time derivative of the ways of pan and putty and of the speed of the pan, whose load has inertia as well."""
    z, s, v = np.clip(state, -10.0, 10.0)
    squeeze, load = z - s, force[0] / knobs["k"]
    mass = np.maximum(knobs[OWN] + load / GRAVITY, LIGHTEST)
    return np.array([v, _flow(structure, knobs, squeeze, s), (load - squeeze - knobs["oil"] * v) / mass])


def _laws(k):
    """The laws, with stiffnesses near a known one."""
    return Laws(
        rates=_loaded_rates,
        structures={structure: (*names, OWN) for structure, names in STRUCTURES.items()},
        box={**BOX, "k": (0.93 * k, 1.07 * k)},
        start=(0.0, 0.0, 0.0),
        sigma=(SIGMA,),
        longest_s=0.1,
        starts=150,
        tried=3,
        rounds=12,
    )


def _stiffness(course):
    """Load over way of the largest way at which the putty surely stays."""
    loads, ways = course.controls[:, 0], course.readings[:, 0]
    elastic = np.flatnonzero((ways < 0.095) & (ways > 1e-4))
    best = elastic[np.argmax(ways[elastic])] if len(elastic) else int(np.argmin(ways))
    return float(loads[best] / max(ways[best], 1e-4))


def predict(structure, knobs):
    """Force that leaves the asked set: by trying many at once, in ever narrower ranges."""
    low, high = knobs["edge"], 8.0
    trial = {name: np.full(60, knobs[name]) for name in STRUCTURES[structure]}
    for _ in range(3):
        force = knobs["k"] * np.linspace(low, high, 60)
        state = np.zeros((2, 60))
        for duration, push in ((PRESSED_S, force), (5.0, 0 * force)):

            def rates(time, now, push=push):
                return _rates(structure, trial, time, now, push[None, :])

            state = advanced(rates, 0.0, state, duration, LONGEST_S)
        beyond = int(np.clip(np.searchsorted(state[1], SET), 1, 59))
        low, high = force[beyond - 1] / knobs["k"], force[beyond] / knobs["k"]
    part = (SET - state[1][beyond - 1]) / (state[1][beyond] - state[1][beyond - 1])
    return float(knobs["k"] * (low + part * (high - low)))


MODEL = Predictor(lambda course: _laws(_stiffness(course)), PAN.course, predict)
fit = MODEL.fit


def rivals(readings):
    """Every law of the putty, fitted."""
    course = PAN.course(readings)
    return members(_laws(_stiffness(course)), course, predict)


def solve(task):
    """Find the scale; then load beyond the yield in small steps, as long as there is room above the catch."""
    seen, number, kg = yield from PAN.scaled(FIRST_KG, GROWTH, SEEN, SETTLE_S)
    kg = kg / GROWTH * 0.085 / PAN.course(seen).readings[-1, 0]
    calls = PAN.load(number, kg, [1.5, 1.0])
    seen += zip(calls, (yield calls), strict=True)
    k, squeeze = _stiffness(PAN.course(seen)), 0.098
    for ball in range(number + 1, 18):
        course = PAN.course(seen)
        ways = course.readings[:, 0]
        rate = max(ways[-1] - ways[-2], 0.0) / course.durations[-1] if squeeze > 0.099 else 0.0
        sunk = max(ways[-1] - course.controls[-1, 0] / k, 0.0)
        room = ROOM - sunk - 1.6 * rate * LOOK_S * LOOKS
        squeeze = squeeze + STEP if squeeze + STEP < room else max(0.75 * squeeze, 0.1)
        calls = PAN.load(ball, k * squeeze / GRAVITY, [LOOK_S] * LOOKS)
        if squeeze + sunk > ROOM or len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


def batch(task):
    """Loads in even ratios, two looks at each, and the best fit."""
    calls = []
    for rung in range(8):
        calls += PAN.load(rung, 0.03 * 1.9**rung, [2.0, 2.0])
    yield [answer(MODEL.best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Press it down at once."""
    readings = yield PAN.load(0, 20.0, [2.0])
    yield [answer(20.0 * GRAVITY * SET / max(PAN.top_m - readings[-1]["position"][2], 0.05))]


def measure(engine, knobs):
    """The force by two trials in the engine without the catch."""

    def left(force):
        free = PAN.pressed(engine, force, PRESSED_S)
        free.push("object_1", force=np.zeros(3))
        free.step(free.whole_steps(5.0))
        return PAN.way(free)

    near = predict(knobs["kind"], knobs)
    first, last = left(0.97 * near), left(1.03 * near)
    return float(near * (0.97 + 0.06 * (SET - first) / (last - first)))


def naive(knobs):
    """The putty's speed at an excess of 0.05 m carried on in proportion; the elastic law alone."""
    return {
        "elastic": knobs["k"] * SET,
        "in proportion": predict("even", knobs) if knobs["kind"] != "even" else knobs["k"] * SET,
    }
