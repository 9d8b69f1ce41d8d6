"""Scene 36: push the hull to and fro below the guard, fit what it drags along, compute the forces at 4 m/s."""

from math import pi

import numpy as np

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

STRUCTURES = {
    "plain": ("mass", "quad", "lin"),
    "water": ("mass", "quad", "drag", "water"),
    "anchor": ("mass", "quad", "line", "anchor"),
}
BOX = {
    "quad": (0.05, 0.9),
    "lin": (0.1, 3.0),
    "drag": (0.2, 5.0),
    "water": (0.2, 6.0),
    "line": (0.2, 4.0),
    "anchor": (0.2, 4.0),
}
SPEED, PERIOD_S = 4.0, 10.0
FIRST_N, GROWTH, SEEN, SEARCH_S = 0.03, 5.0, 0.12, 0.6
LEG_S, CALLS, LEGS_AT_ONCE = 1.05, 149, 3
FAST, TURN, ROOM = 1.5, 1.9, 3.6


def _rates(structure, knobs, time, state, force):
    """Time derivative of place, speed, and speed of the water or place of the anchor."""
    x, v, other = state
    gain = force[0] / knobs["mass"] - knobs["quad"] * v * np.abs(v)
    if structure == "plain":
        return np.array([v, gain - knobs["lin"] * v, 0 * v])
    if structure == "water":
        pull = knobs["drag"] * (v - other)
        return np.array([v, gain - pull, pull / knobs["water"]])
    pull = knobs["line"] * (x - other)
    return np.array([v, gain - pull, pull / knobs["anchor"]])


RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], significant=5)


def _course(readings):
    """Pushes and readings until the guard takes the hull."""
    course = RIG.course(readings)
    return course.until((np.abs(course.readings[:, 0]) > 4.02) | (np.abs(course.readings[:, 1]) > 2.05))


def predict(structure, knobs):
    """Greatest force of the periodic motion, and force of the steady one."""
    turn = 2 * pi / PERIOD_S
    time = np.linspace(0, PERIOD_S, 20001)
    v = SPEED * np.sin(turn * time)
    lag, steady = 0.0, 0.0
    if structure == "plain":
        lag, steady = knobs["lin"] * v, knobs["lin"] * SPEED
    elif structure == "water":
        answer_of = knobs["drag"] * 1j * turn / (1j * turn + knobs["drag"] / knobs["water"])
        lag = np.imag(answer_of * SPEED * np.exp(1j * turn * time))
    else:
        answer_of = knobs["line"] / (1j * turn + knobs["line"] / knobs["anchor"])
        lag, steady = np.imag(answer_of * SPEED * np.exp(1j * turn * time)), knobs["anchor"] * SPEED
    whole = SPEED * turn * np.cos(turn * time) + knobs["quad"] * v * np.abs(v) + lag
    return [float(knobs["mass"] * whole.max()), float(knobs["mass"] * (knobs["quad"] * SPEED**2 + steady))]


def _near(course):
    """The laws, with masses near the one that fits roughly."""
    mass = min(max(_guess(course)[0], 0.1), 600.0)
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box={**BOX, "mass": (0.3 * mass, 6.0 * mass)},
        start=(0.0, 0.0, 0.0),
        sigma=(0.007, 0.012),
        longest_s=0.4,
        starts=150,
        tried=2,
        rounds=10,
    )


MODEL = Predictor(_near, _course, predict)


def _guess(course):
    """Mass, linear and square resistance that fit the legs roughly."""
    x, v = (np.concatenate(([0.0], course.readings[:, column])) for column in (0, 1))
    first, last, way = v[:-1], v[1:], x[1:] - x[:-1]
    table = np.column_stack([last - first, way, way * np.abs(way) / course.durations])
    moving = np.abs(last) > 0.03
    pull = course.controls[:, 0] * course.durations
    if moving.sum() < 5:
        size = float(table[moving, 0] @ pull[moving] / (table[moving, 0] @ table[moving, 0]))
        return np.array([size, 0.5 * size, 0.1 * size])
    return np.linalg.lstsq(table[moving], pull[moving], rcond=None)[0]


def _plan(p, x, v, target):
    """Force that brings the hull from a speed to another within a leg, and the place then."""
    middle = (v + target) / 2
    return float(p[0] * (target - v) / LEG_S + p[1] * middle + p[2] * middle * abs(middle)), x + LEG_S * middle


def solve(task):
    """Weak pushes, growing until the hull moves; then to and fro, faster on every second way."""
    seen, _ = yield from RIG.touched(FIRST_N, GROWTH, SEARCH_S, lambda reading: reading[1] >= SEEN)
    side, number, fast = 1, 0, 0.8
    while len(seen) + 4 <= CALLS:
        course = _course(seen)
        p, calls = _guess(course), []
        x, v = course.readings[-1]
        for _ in range(min(LEGS_AT_ONCE, (CALLS - len(seen)) // 4)):
            if side * x > TURN or side * (x + LEG_S * v) > ROOM - 0.6:
                side, number = -side, number + 1
                fast = (FAST, 0.9, FAST, 1.2)[number % 4]
            target = side * fast if side * x < 0.9 else side * 0.5
            push, x = _plan(p, x, v, min(max(target, v - 1.6), v + 1.6))
            v = min(max(target, v - 1.6), v + 1.6)
            calls += RIG.leg(push, LEG_S)
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


fit = MODEL.fit


def rivals(readings):
    """What may be besides the square law, each fitted to the course."""
    course = _course(readings)
    return members(_near(course), course, predict)


def measure(engine, knobs):
    """Both motions in the engine without guard: the force is the change of momentum and what the hull is held with."""
    free = _unguarded(engine)
    turn, mass = 2 * pi / PERIOD_S, knobs["mass"]
    tick = 1 / free.whole_steps(1.0)
    push, greatest, count = 0.0, 0.0, free.whole_steps(4 * PERIOD_S)
    for number in range(count):
        aim = SPEED * np.sin(turn * (number + 1) * tick)
        push += mass * 20 * (SPEED * np.sin(turn * number * tick) - float(free.twist("object_1").linear[0]))
        now = push + mass * 60 * (aim - float(free.twist("object_1").linear[0]))
        free.push("object_1", force=np.array([now, 0.0, 0.0]))
        free.step(1)
        if number > count / 2:
            greatest = max(greatest, now)
    for _ in range(free.whole_steps(50.0)):
        push += mass * 2 * (SPEED - float(free.twist("object_1").linear[0]))
        now = push + mass * 60 * (SPEED - float(free.twist("object_1").linear[0]))
        free.push("object_1", force=np.array([now, 0.0, 0.0]))
        free.step(1)
    return [float(greatest), float(now)]


def settles(engine, knobs, off):
    """By how much the speed is off after a minute under the steady force."""
    free = _unguarded(engine)
    free.set_velocity("object_1", np.array([(1 + off) * SPEED, 0.0, 0.0]))
    free.push("object_1", force=np.array([predict(knobs["kind"], knobs)[1], 0.0, 0.0]))
    free.step(free.whole_steps(60.0))
    return float(free.twist("object_1").linear[0]) / SPEED - 1


def _unguarded(engine):
    return engine.changed({"joint[object_1_x].range": (-1e4, 1e4), "body[trigger]/inertial.mass": 1e12})


def naive(knobs):
    """Without what lags; as if all that resists was a linear law, or a square law, as at a steady 1 m/s."""
    law = {name: knobs[name] for name in ("mass", "quad")}
    steady = predict(knobs["kind"], knobs)[1] / knobs["mass"] - knobs["quad"] * SPEED**2
    at_one = knobs["quad"] + steady / SPEED
    return {
        "square law of the steady motion": predict("plain", {**law, "quad": at_one, "lin": 0.0}),
        "linear law of the steady motion": predict("plain", {**law, "quad": 0.0, "lin": at_one}),
    }


def stage(task):
    """Push as hard as possible for long."""
    readings = yield [*RIG.leg(1000.0, 1.0), *RIG.leg(1000.0, 8.0)]
    speed = max(abs(readings[3]["velocity"][0]), 0.05)
    yield [answer([1000.0 * SPEED / speed, 1000.0 * (SPEED / speed) ** 2])]


def batch(task):
    """Pushes to and fro in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(15) for asked in RIG.leg(0.1 * 1.85**n * (-1) ** n, 1.6)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]
