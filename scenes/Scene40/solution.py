"""Scene 40: lead the cart to and fro between the guard's places, fit how its effective mass grows, carry it on."""

import numpy as np
from scipy.optimize import nnls

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

POWERS = {"line": 1, "square": 2, "cube": 3}
UNIT_M = 2.4
BOX = {"mass": (0.03, 200.0), "growth": (0.2, 4.0)}
ASKED_N, ASKED_M = 20.0, 7.2
OWN = 0.01
"""Mass of the cart over the effective mass at the start."""
FIRST_N, GROWTH, SEEN = 0.02, 3.0, 0.12
SEARCH_S, LEG_S, GREATEST_N = 0.3, 0.38, 780.0
CALLS, LEGS_AT_ONCE, SLOW_LEGS = 149, 4, 6
LEFT_M, RIGHT_M, SLOW, FAST, GAIN = 0.1, 2.25, 0.5, 0.8, 1.6
"""Places between which the cart is led, its greatest speeds, and the greatest change of its speed per second."""


def _effective(structure, knobs, x):
    """Effective mass at a place, and how fast it changes with the place."""
    power, x = POWERS[structure], np.maximum(x, 0.0)
    turns = 1 + knobs["growth"] * (x / UNIT_M) ** power
    slope = knobs["growth"] * power * x ** (power - 1) / UNIT_M**power
    return knobs["mass"] * (OWN + (1 - OWN) * turns**2), knobs["mass"] * (1 - OWN) * 2 * turns * slope


def _rates(structure, knobs, time, state, force):
    """Time derivative of place and speed: the work of the push is the change of the energy."""
    x, v = state
    mass, slope = _effective(structure, knobs, x)
    return np.array([v, (force[0] - slope * v * v / 2) / mass])


LAWS = Laws(
    rates=_rates,
    structures=dict.fromkeys(POWERS, ("mass", "growth")),
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.014, 0.028),
    longest_s=0.12,
    starts=200,
    tried=4,
    rounds=12,
)


RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], significant=5)


def _course(readings):
    """Pushes and readings until the guard grips."""
    course = RIG.course(readings)
    x, v = course.readings.T
    moving = np.nonzero((np.abs(v) > 0.1) | (np.abs(np.diff(x, prepend=0.0)) > 0.07))[0]
    end = len(v)
    if len(moving) and moving[-1] < end - 2:  # it stands for good: the guard gripped in the last leg with motion
        end = max(moving[-1], 1)
    return course.first(end)


def predict(structure, knobs):
    """Speed at the asked place: the work of the push, all of it in the motion."""
    return float(np.sqrt(2 * ASKED_N * ASKED_M / _effective(structure, knobs, ASKED_M)[0]))


MODEL = Predictor(LAWS, _course, predict)


def _columns(x, v, to_x, to_v):
    """Change of momentum for effective masses that are powers of the place, in a leg without bends."""
    x, to_x = np.maximum(x, 0), np.maximum(to_x, 0)
    middle, speed = (x + to_x) / 2, (v + to_v) / 2
    powers = range(4)
    slope = [n * middle ** (n - 1) if n else 0 * middle for n in powers]
    return np.stack(
        [middle**n * (to_v - v) + slope[n] * (speed**2 + (to_v - v) ** 2 / 12) * LEG_S / 2 for n in powers], axis=-1
    )


def _guess(course):
    """Effective mass as a polynomial of the place."""
    x, v = (np.concatenate(([0.0], course.readings[:, column])) for column in (0, 1))
    table = _columns(x[:-1], v[:-1], x[1:], v[1:])
    legs = np.abs(course.durations - LEG_S) < 0.01
    if legs.sum() < 3:
        return np.array([float(course.controls[:, 0] @ course.durations) / max(v[-1], 0.01), 0.0, 0.0, 0.0])
    return nnls(table[legs], (course.controls[:, 0] * course.durations)[legs])[0]


def _next(x, v, ahead, top):
    """Speed at the end of the next leg, and the sense of motion then."""
    for sense in (ahead, -ahead):
        for target in sense * np.arange(top, 0.0, -0.05):
            to_x = x + (v + target) / 2 * LEG_S
            room = RIGHT_M - to_x if sense > 0 else to_x - LEFT_M
            if abs(target - v) <= GAIN * LEG_S and room > abs(target) * LEG_S / 4 + target**2 / 2 / GAIN:
                return target, sense
    return v - np.sign(v) * min(abs(v), GAIN * LEG_S), ahead


def solve(task):
    """Weak pushes, growing until the cart moves; then to and fro, slowly first."""
    seen, _ = yield from RIG.touched(FIRST_N, GROWTH, SEARCH_S, lambda reading: reading[1] >= SEEN)
    number, ahead = 0, 1
    while len(seen) + 4 <= CALLS:
        course = _course(seen)
        p, calls = _guess(course), []
        x, v = course.readings[-1]
        for _ in range(min(1 if number < SLOW_LEGS else LEGS_AT_ONCE, (CALLS - len(seen)) // 4)):
            target, ahead = _next(x, v, ahead, SLOW if number < SLOW_LEGS else FAST)
            to_x = x + (v + target) / 2 * LEG_S
            pushed = float(_columns(x, v, to_x, target) @ p) / LEG_S
            x, v, number = to_x, target, number + 1
            calls += RIG.leg(float(np.clip(pushed, -GREATEST_N, GREATEST_N)), LEG_S)
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


fit = MODEL.fit


def rivals(readings):
    """Each power of the place, fitted."""
    return members(LAWS, _course(readings), predict)


def measure(engine, knobs):
    """The push in the engine, without the guard."""
    free = engine.changed({"body[most].pos": (1000.0, 0.0, 0.0)})
    free.push("object_1", force=np.array([ASKED_N, 0.0, 0.0]))
    before = (0.0, 0.0)
    while True:
        free.step(1)
        now = float(free.pose("object_1").position[0]), float(free.twist("object_1").linear[0])
        if now[0] >= ASKED_M:
            return now[1] - (now[0] - ASKED_M) / (now[0] - before[0]) * (now[1] - before[1])
        before = now


def naive(knobs):
    """The effective mass as it is at the start; as it is at 2.4 m."""
    work = 2 * ASKED_N * ASKED_M
    masses = {name: _effective(knobs["kind"], knobs, x)[0] for name, x in (("start", 0.0), ("2.4 m", UNIT_M))}
    return {f"mass as at {name}": float(np.sqrt(work / mass)) for name, mass in masses.items()}


def stage(task):
    """Push as asked, and read the speed at the end."""
    calls = [*RIG.leg(ASKED_N, 1.0), *RIG.leg(ASKED_N, 17.0)]
    readings = yield calls
    yield [answer(max(abs(readings[7]["velocity"][0]), 1e-3))]


def batch(task):
    """Pairs of pushes forth and back in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(7) for sign in (1, -0.8) for asked in RIG.leg(sign * 0.1 * 2.6**n, 0.8)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]
