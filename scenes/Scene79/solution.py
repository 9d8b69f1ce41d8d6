"""Scene 79: let the distance swing wider and wider short of the hooks, fit push, pull and cord, balance energies."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import Course, Laws, force, position, recorded, velocity
from scenes.family import members
from scenes.fitting import refined
from scenes.protocol import answer, call

SPEED, FORCE, NEAR_M, FAR_M, NET_M = 2.5, 4.0, 0.7, 1.4, 3.0
_COMMON = ("m1", "m2", "a", "p")
STRUCTURES = {
    "steady": _COMMON,
    "spring": (*_COMMON, "b"),
    "steady cord": (*_COMMON, "c", "begins"),
    "spring cord": (*_COMMON, "b", "c", "begins"),
}
BOX = {
    "m1": (0.01, 15.0),
    "m2": (0.005, 40.0),
    "a": (0.5, 15.0),
    "p": (1.0, 5.5),
    "b": (0.2, 4.0),
    "c": (1.5, 25.0),
    "begins": (1.15, 1.3),
}
"""Push at 1 m over the reduced mass; its power; growth of the pull and stiffness of the cord, over the pull at 1 m."""
REACHES = (0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.88, 0.94)
"""How far the distance is let go in each iteration that has a model, over the way to the hooks; the last goes on."""
TIME_S, CALLS, ITERATIONS = 10.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 5, 3, 200
TOUCHES, VISIBLE = (0.01, 0.06, 0.36, 2.0, 4.0), 0.03
"""First forces in N, each for 0.2 s, until the speed is seen, in m/s."""


def _strength(knobs, d):
    """Force that drives the gliders apart, over the reduced mass."""
    d = np.maximum(d, 0.05)
    pull = 1 + knobs.get("b", 0.0) * (d - 1)
    if "c" in knobs:
        pull = pull + knobs["c"] * np.maximum(d - knobs["begins"], 0.0)
    return knobs["a"] * (d ** -knobs["p"] - pull)


def _rates(structure, knobs, time, state, control):
    """Time derivative of both places and both speeds."""
    x1, x2, v1, v2 = np.clip(state, -50.0, 50.0)
    apart = _strength(knobs, x2 - x1) / (1 / knobs["m1"] + 1 / knobs["m2"])
    return np.array([v1, v2, (control[0] - apart) / knobs["m1"], apart / knobs["m2"]])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(-0.5, 0.5, 0.0, 0.0),
    sigma=(0.00034, 0.00034, 0.00096, 0.00096),
    longest_s=0.05,
    starts=150,
    tried=3,
    rounds=10,
)


def _course(readings):
    """Forces, places and speeds, up to where a hook caught."""
    seen = [of(body, 0) for of in (position, velocity) for body in ("object_1", "object_2")]
    raw = recorded(readings, [force("object_1", 0)], seen)
    d = raw.readings[:, 1] - raw.readings[:, 0]
    lost = np.nonzero((d < NEAR_M + 0.005) | (d > FAR_M - 0.005) | (abs(raw.readings[:, :2]).max(axis=1) > NET_M))[0]
    kept = int(lost[0]) if len(lost) else len(d)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants of a pull like a spring's at points of the unit cube."""
    names = STRUCTURES["spring"]
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(names, unit, strict=True)}


def _roughly(course, unit):
    """The constants from one leg after the other, from a point of the unit cube or anywhere."""
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        ends = LAWS.advanced("spring", _constants(units), 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (2 * np.array(LAWS.sigma)[:, None])
        return np.vstack([np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1]), units - 0.5])

    if unit is None:
        units = np.random.default_rng(1).random((5, 400))
        unit = units[:, np.argmin(np.log1p(misfits(units) ** 2).sum(axis=0))]
        unit = refined(misfits, unit, 12)
    return refined(misfits, unit, 6)


def _planned(knobs, state, span, reach):
    """Forces for the next legs: of many at random, those that make the distance swing, but not beyond the reach."""
    rng = np.random.default_rng(2)
    strongest = min(FORCE, 1.2 * reach * knobs["a"] * knobs["m1"])
    forces = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states = np.array(state)[:, None] + np.zeros(TRIALS)
    least, most, value = 1 - reach * (1 - NEAR_M), 1 + reach * (FAR_M - 1), np.zeros(TRIALS)
    for held in forces:
        for _ in range(LOOKS):
            states = LAWS.advanced("spring", knobs, 0.0, states, span / LOOKS, held[None, :])
            d = np.nan_to_num(states[1] - states[0], nan=9.0)
            value -= 1e3 * (np.maximum(d - most, 0.0) + np.maximum(least - d, 0.0))
            value += np.maximum(d - 1, 1 - d) + 5 * np.maximum(np.minimum(d, most) - 1.25, 0.0)
            value += 8 * np.maximum(0.85 - np.maximum(d, least), 0.0)
    middle = (states[0] * knobs["m1"] + states[1] * knobs["m2"]) / (knobs["m1"] + knobs["m2"])
    drift = (states[2] * knobs["m1"] + states[3] * knobs["m2"]) / (knobs["m1"] + knobs["m2"])
    value -= 3 * np.maximum(abs(middle + 2 * drift) - 0.8, 0.0)
    return forces[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    looks = [
        call(f"get_{what}", object_id=body) for what in ("position", "velocity") for body in ("object_1", "object_2")
    ]
    return [
        call("apply_force", object_id="object_1", force_vector=[round(float(strength), 4), 0, 0]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        *looks,
    ]


def solve(task):
    """Touches until object_1 moves, then forces that the model so far chooses."""
    seen = []
    for strength in TOUCHES:
        calls = _push(strength, 0.2)
        seen += zip(calls, (yield calls), strict=True)
        if abs(_course(seen).readings[-1, 2]) > VISIBLE:
            break
    calls = [*_push(0.0, 0.3), *_push(0.0, 0.3)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.2
    for _ in range(ITERATIONS - 5):
        course = _course(seen)
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(0.9 / np.sqrt(knobs["a"] * (knobs["p"] + knobs["b"])), 0.1, 0.6))
        spent += LEGS * span
        if len(seen) + 6 * LEGS > CALLS or spent > TIME_S:
            break
        d = course.readings[:, 1] - course.readings[:, 0]
        wide = max((1 - d.min()) / (1 - NEAR_M), (d.max() - 1) / (FAR_M - 1))
        reach, reaches = min(reaches[0], 0.1 + 2 * wide), reaches[1:] or reaches
        calls = [asked for f in _planned(knobs, course.readings[-1], span, reach) for asked in _push(f, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(predict(*LAWS.best(_course(seen))))]


def _potential(knobs, d):
    """Potential energy over the reduced mass, from 1 m on."""
    p = knobs["p"]
    push = np.log(d) if abs(p - 1) < 1e-6 else (d ** (1 - p) - 1) / (1 - p)
    cord = knobs.get("c", 0.0) * max(d - knobs.get("begins", 1.0), 0.0) ** 2 / 2
    return knobs["a"] * (d - 1 + knobs.get("b", 0.0) * (d - 1) ** 2 / 2 + cord - push)


def predict(structure, knobs):
    """Smallest and largest distance."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}

    def left(d):
        return _potential(knobs, d) - SPEED**2 / 2

    least = brentq(left, 0.001, 1.0) if left(0.001) > 0 else 0.001
    return [float(least), float(brentq(left, 1.0, 1e4)) if left(1e4) > 0 else 1e4]


def fit(readings, structure):
    """Both distances by the pull of a structure."""
    return predict(structure, LAWS.fitted(_course(readings), structure)[1])


def rivals(readings):
    """Each pull, with and without a cord, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """Small oscillations carried on; object_2 does not recoil."""
    stiffness = knobs["a"] * (knobs["p"] + knobs["b"])
    swing = SPEED / np.sqrt(stiffness)
    heavy = predict(knobs["kind"], {**knobs, "a": knobs["a"] * knobs["mu"] / knobs["m1"]})
    return {"harmonic": [max(1 - swing, 0.0), 1 + swing], "without recoil": heavy}


def stage(task):
    """Push as hard as possible, one way and the other."""
    calls = [*_push(FORCE, 0.2), *_push(FORCE, 0.2), *_push(-FORCE, 0.4), *_push(-FORCE, 0.4)]
    readings = yield calls
    places = [reading["position"][0] for reading in readings if "position" in reading]
    d = [right - left for left, right in zip(places[::2], places[1::2], strict=True)]
    yield [answer([min(d), max(d)])]


def batch(task):
    """Pushes to and fro, stronger and stronger, and the same fit."""
    forces = (0.05, 0.0, -0.2, 0.0, 0.8, -0.8, 2.0, -2.0, 4.0, -4.0)
    calls = [asked for f in forces for asked in _push(f, 0.4)]
    readings = yield calls
    yield [answer(predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """Both blows in the engine, without hooks and nets."""
    ends = []
    for sign in (1, -1):
        free = engine.changed(
            {"body[hook].pos": (0.0, 0.0, 0.0), "key[start].qvel": (sign * SPEED, 0.0, 0.0, 0.0, 0.0)}
        )
        path = [1.0]
        while len(path) < 3 or sign * path[-1] < sign * path[-2]:
            free.step(1)
            path.append(float(free.pose("object_2").position[0] - free.pose("object_1").position[0]))
        ends.append(path[-2])
    return ends
