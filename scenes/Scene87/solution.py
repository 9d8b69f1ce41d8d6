"""Scene 87: lead the diver up and down between the nets, fit gas, water and drag, and follow it into the deep."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from scenes.courses import Course, Laws, force, position, recorded, refined, velocity
from scenes.protocol import answer, call

FORCE, NET_M, DEEP_M, START_M_S, PASSED_M = 10.0, 1.0, 3.0, 5.0, 3.0
STRUCTURES = {
    "fresh, fast": ("m", "g", "h", "q"),
    "salt, fast": ("m", "g", "h", "s", "q"),
    "salt, slow": ("m", "g", "h", "s", "c"),
}
PLAIN = ("m", "g", "h", "q", "c")
"""Constants with which the next forces are planned."""
BOX = {
    "m": (0.003, 5.0),
    "g": (0.8, 15.0),
    "h": (1.2, 5.0),
    "s": (0.02, 2.5),
    "q": (0.05, 5.0),
    "c": (0.05, 5.0),
}
"""Mass; over it, weight less buoyancy far below; depth at which the gas has half its volume; growth of the buoyancy
with depth; drag with the square of the speed, or with the speed."""
REACHES = (0.3, 0.6, 0.8, 0.88, 0.92)
"""How far the diver is let go in each iteration that has a model, in m; the last one goes on."""
FAR_M, TIME_S, CALLS, ITERATIONS = 0.5, 18.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 3, 5, 3, 300
TOUCHES, VISIBLE, TOUCH_S = (0.005, 0.02, 0.08, 0.32, 1.28, 5.0, 10.0), 0.03, 0.15
"""First forces in N until the speed is seen, in m/s."""


def _rates(structure, knobs, time, state, control):
    """Time derivative of height and speed upwards."""
    z, v = np.clip(state, -50.0, 50.0)
    sinks = -knobs["g"] * z / np.maximum(knobs["h"] - z, 0.05)
    salt = -knobs["s"] * z if "s" in knobs else 0.0
    drag = knobs.get("q", 0.0) * abs(v) + knobs.get("c", 0.0)
    return np.array([v, control[0] / knobs["m"] - sinks + salt - drag * v])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.00013, 0.00025),
    longest_s=0.1,
    starts=120,
    tried=3,
    rounds=10,
)


def _course(readings):
    """Forces, heights and speeds, up to where a net caught."""
    raw = recorded(readings, [force("object_1", 2)], [position("object_1", 2), velocity("object_1", 2)])
    lost = np.nonzero(abs(raw.readings[:, 0]) > NET_M - 0.005)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(names, unit):
    """Constants at points of the unit cube."""
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(names, unit, strict=True)}


def _by_legs(course, names, unit=None, *, precise=False):
    """Chi-square and constants, as a point of the unit cube, of the best fit to each leg from the readings before it.

    The diver leaves every height by itself, so that a course as a whole would depend on its start far too much.
    """
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        knobs = _constants(names, units)
        ends = LAWS.advanced("legs", knobs, 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (1.6 * np.array(LAWS.sigma)[:, None])
        off = np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1])
        return np.vstack([off, 0.3 * (units - 0.5)])

    if unit is None:
        units = np.random.default_rng(1).random((len(names), 400))
        order = np.argsort(np.log1p(misfits(units) ** 2).sum(axis=0))[:2]
        found = [refined(misfits, units[:, start], 15) for start in order]
        unit = min(found, key=lambda unit: float((misfits(unit[:, None]) ** 2).sum()))
    unit = refined(misfits, unit, 8)
    if precise:  # gas and salt nearly make up for each other: a long narrow valley
        unit = least_squares(lambda point: misfits(point[:, None])[:, 0], unit, method="lm", max_nfev=150).x
    return float((misfits(unit[:, None]) ** 2).sum()), unit


def _best(course):
    """The structure that fits best, each constant paid for, and its constants."""
    fits = {name: _by_legs(course, names, precise=True) for name, names in STRUCTURES.items()}
    name = min(fits, key=lambda name: fits[name][0] + 4 * len(STRUCTURES[name]))
    return name, _constants(STRUCTURES[name], fits[name][1])


def _planned(knobs, state, span, reach, side):
    """Forces for the next legs: of many at random, those that carry the diver to a side, within the reach."""
    rng = np.random.default_rng(2)
    strongest = min(FORCE, (2.0 * knobs["g"] / knobs["h"] + 3.0) * reach * knobs["m"])
    forces = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for held in forces:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held[None, :])
            place = np.nan_to_num(abs(states[0]), nan=9.0)
            value += 10 * np.maximum(np.minimum(side * states[0], reach) - FAR_M, 0.0) + place
            value -= 1e3 * np.maximum(place - reach, 0.0)
    return forces[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_force", object_id="object_1", force_vector=[0, 0, round(float(strength), 6)]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Touches until the diver moves, then forces that the model so far chooses."""
    seen = []
    for strength in TOUCHES:
        calls = _push(strength, TOUCH_S)
        seen += zip(calls, (yield calls), strict=True)
        if abs(_course(seen).readings[-1, 1]) > VISIBLE:
            break
    calls = [*_push(0.0, 0.2), *_push(0.0, 0.2)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.2
    for number in range(ITERATIONS - 5):
        course = _course(seen)
        _, unit = _by_legs(course, PLAIN, unit)
        knobs = _constants(PLAIN, unit)
        span = float(np.clip(0.7 / np.sqrt(knobs["g"] / knobs["h"]), 0.2, 0.5))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.08 + 2.2 * wide), reaches[1:] or reaches
        planned = _planned(knobs, course.readings[-1], span, reach, (-1) ** number)
        calls = [asked for strength in planned for asked in _push(strength, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*_best(_course(seen))))]


def _predict(structure, knobs):
    """Force that holds the diver in the deep, and its speed after a start downwards."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    holds = -knobs["m"] * float(_rates(structure, knobs, 0.0, np.array([-DEEP_M, 0.0]), [0.0])[1])

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    def passes(time, state):
        return state[0] + PASSED_M

    def turns(time, state):
        return state[1]

    passes.terminal = turns.terminal = True
    end = solve_ivp(rates, (0, 60), [0.0, -START_M_S], events=[passes, turns], rtol=1e-8, atol=1e-9).y[:, -1]
    return [holds, -float(end[1])]


def fit(readings, structure):
    """The answer by the water and the drag of a structure."""
    names = STRUCTURES[structure]
    return _predict(structure, _constants(names, _by_legs(_course(readings), names, precise=True)[1]))


def structure(knobs):
    """Whether the water is salt, and how it drags."""
    return knobs["kind"]


def theory(knobs):
    """The balance of forces, and the motion downwards."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """Forces in proportion to the depth; the diver of no gas left, in fresh water."""
    stiff = knobs["g"] / knobs["h"] - (knobs["s"] if "salt" in knobs["kind"] else 0.0)
    line = {**knobs, "g": 1e4 * stiff, "h": 1e4, "s": 0.0}
    return {"in proportion": _predict(knobs["kind"], line), "no gas left": [knobs["m"] * knobs["g"], START_M_S]}


def stage(task):
    """Push it down; the net catches it."""
    readings = yield [*_push(-FORCE, 0.5), *_push(-FORCE, 0.5), *_push(-FORCE, 2.0)]
    yield [answer([FORCE, max(abs(reading["velocity"][2]) for reading in readings[3::4]) + 0.001])]


def batch(task):
    """Pushes to and fro, stronger and stronger, and the same fit."""
    forces = (0.005, -0.01, 0.0, 0.02, -0.05, 0.0, 0.1, -0.2, 0.0, 0.5, -1.0, 0.0, 3.0, -6.0, 10.0)
    calls = [asked for strength in forces for asked in _push(strength, 0.5)]
    readings = yield calls
    yield [answer(_predict(*_best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """Without nets: the change of speed in a step from rest in the deep; the start downwards."""
    free = engine.changed({"body[net].pos": (0.0, 0.0, 0.0), "key[start].qpos": (-DEEP_M,)})
    free.step(1)
    holds = -knobs["m"] * float(free.twist("object_1").linear[2]) * free.whole_steps(1.0)
    free = engine.changed({"body[net].pos": (0.0, 0.0, 0.0), "key[start].qvel": (-START_M_S,)})
    path = [(0.0, START_M_S)]
    while path[-1][0] < PASSED_M and path[-1][1] > 0:
        free.step(1)
        path.append((-float(free.pose("object_1").position[2]), -float(free.twist("object_1").linear[2])))
    return [holds, path[-1][1]]
