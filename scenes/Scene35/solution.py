"""Scene 35: lead the cart on for the whole time below the guard's speed, fit how its bearings change, carry it on."""

import numpy as np

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

STRUCTURES = {
    "floor": ("mass", "rate", "floor", "length"),
    "ceiling": ("mass", "rate", "ceiling", "length"),
    "fading": ("mass", "rate", "half"),
    "heavier": ("mass", "rate", "twice"),
}
BOX = {
    "mass": (0.05, 100.0),
    "rate": (0.7, 8.0),
    "floor": (0.03, 0.9),
    "ceiling": (1.2, 9.0),
    "length": (1.2, 15.0),
    "half": (1.5, 30.0),
    "twice": (3.0, 80.0),
}
ASKED_M, ASKED_SPEED = 60.0, 1.0
FIRST_N, GROWTH, SEEN = 0.02, 5.0, 0.1
LEG_S, CALLS, LEGS_AT_ONCE = 0.55, 149, 3
SPEEDS = (0.6, 1.0, 1.15, 0.8, 1.2, 1.2, 0.9, 1.2, 1.22, 1.22)
LAB_S = 19.9


def _share(structure, knobs, way):
    """Resistance per speed after a way, over that at the start."""
    if structure in ("floor", "ceiling"):
        return knobs[structure] + (1 - knobs[structure]) * np.exp(-way / knobs["length"])
    return 1 / (1 + way / knobs["half"]) if structure == "fading" else 1 + way / knobs["twice"]


def _rates(structure, knobs, time, state, force):
    """Time derivative of place and speed; the cart goes on all the time, so the way is its place."""
    x, v = state
    return np.array([v, force[0] / knobs["mass"] - knobs["rate"] * _share(structure, knobs, np.maximum(x, 0)) * v])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.006, 0.014),
    longest_s=0.2,
    starts=600,
    tried=6,
    rounds=12,
)


RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], significant=5)


def _course(readings):
    """Pushes and readings until the guard grips."""
    course = RIG.course(readings)
    v = course.readings[:, 1]
    return course.until((np.maximum.accumulate(v) > 0.3) & (v < 0.1) & (course.controls[:, 0] > 0))


def predict(structure, knobs):
    """Force at the speed and after the way that are asked."""
    return float(knobs["mass"] * knobs["rate"] * _share(structure, knobs, ASKED_M) * ASKED_SPEED)


MODEL = Predictor(LAWS, _course, predict)


def _guess(course):
    """Mass, and resistance per speed as a polynomial of the way."""
    v, x = (np.concatenate(([0.0], course.readings[:, column])) for column in (1, 0))
    way, middle = x[1:] - x[:-1], (x[1:] + x[:-1]) / 2
    moving = v[1:] > 0.04
    powers = int(np.clip(moving.sum() // 4 - 1, 0, 3))
    table = np.column_stack([v[1:] - v[:-1], *(way * middle**n for n in range(powers + 1))])[moving]
    return np.linalg.lstsq(table, (course.controls[:, 0] * course.durations)[moving], rcond=None)[0]


def _plan(p, x, v, target):
    """Force that brings the cart from a speed to another within a leg."""
    way = LEG_S * (v + target) / 2
    share = sum(size * (x + way / 2) ** n for n, size in enumerate(p[1:]))
    return max(0.0, float(p[0] * (target - v) + share * way) / LEG_S), x + way


def solve(task):
    """Weak pushes, growing until the cart moves; then on and on near the guard's speed."""
    seen, push = yield from RIG.touched(FIRST_N, GROWTH, 0.3, lambda reading: reading[1] >= SEEN)
    scale = SEEN * push / seen[-1][1]["velocity"][0]
    calls = [*RIG.leg(2 * scale, 0.3), *RIG.leg(3 * scale, 0.3), *RIG.leg(scale, 0.3)]
    seen += zip(calls, (yield calls), strict=True)
    number, time = 0, 0.0
    while len(seen) + 4 <= CALLS:
        course = _course(seen)
        p, calls, time = _guess(course), [], float(course.durations.sum())
        x, v = course.readings[-1]
        for _ in range(min(1 if number < 4 else LEGS_AT_ONCE, (CALLS - len(seen)) // 4)):
            target = SPEEDS[number] if number < len(SPEEDS) else SPEEDS[-1 - (number % 5 == 0)]
            push, x = _plan(p, x, v, target)
            v, number, time = target, number + 1, time + LEG_S
            if time > LAB_S:
                break
            calls += RIG.leg(push, LEG_S)
        if not calls:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


fit = MODEL.fit


def rivals(readings):
    """Each law of the bearings, fitted."""
    return members(LAWS, _course(readings), predict)


def measure(engine, knobs):
    """The loss of speed in one step of the engine, after the way that is asked."""
    free = engine.changed({"body[most].pos": (100.0, 0.0, 0.0)})
    free.place("meter", np.array([0.0, 3.0, ASKED_M]), {})
    free.set_velocity("object_1", np.array([ASKED_SPEED, 0.0, 0.0]))
    free.step(1)
    lost = np.log(ASKED_SPEED / float(free.twist("object_1").linear[0]))
    return knobs["mass"] * lost * free.whole_steps(1.0) * ASKED_SPEED


def settles(engine, knobs, off):
    """By how much the speed is off after half a minute under the asked force, with the bearings as after the way."""
    free = engine.changed({"body[most].pos": (100.0, 0.0, 0.0), "geom[meter_geom].mass": 1e12})
    free.place("meter", np.array([0.0, 3.0, ASKED_M]), {})
    free.set_velocity("object_1", np.array([(1 + off) * ASKED_SPEED, 0.0, 0.0]))
    free.push("object_1", force=np.array([predict(knobs["kind"], knobs), 0.0, 0.0]))
    free.step(free.whole_steps(30.0))
    return float(free.twist("object_1").linear[0]) / ASKED_SPEED - 1


def naive(knobs):
    """As it is after 15 m; an even change per metre, by a factor, as from 5 m to 15 m."""
    now, before = (knobs["c"] * _share(knobs["kind"], knobs, way) for way in (15.0, 5.0))
    return {"as after 15 m": now, "same factor per metre": now * (now / before) ** 4.5}


def stage(task):
    """Lead it on at a walking pace for as long as 60 m take."""
    readings = yield [*RIG.leg(0.5, 9.0), *RIG.leg(0.5, ASKED_M / ASKED_SPEED)]
    yield [answer(0.5 / max(readings[7]["velocity"][0], 1e-3) * ASKED_SPEED)]


def batch(task):
    """Pushes in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(15) for asked in RIG.leg(0.2 * 1.5**n, 1.3)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]
