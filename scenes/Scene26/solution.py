"""Scene 26: fit friction and resistance to the cart's motion below the guard, then integrate from 6 m/s to rest."""

import numpy as np
from scipy.optimize import brentq, nnls

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.family import members
from scenes.protocol import answer, call

STRUCTURES = {"air": ("mass", "dry", "gamma"), "oil": ("mass", "dry", "beta"), "magnet": ("mass", "dry", "eps", "w")}
"""Dry friction is meant per mass, the others are meant over dry friction."""
BOX = {
    "mass": (0.3, 120.0),
    "dry": (0.05, 6.0),
    "beta": (0.05, 3.0),
    "gamma": (0.03, 2.0),
    "eps": (1.0, 14.0),
    "w": (0.6, 1.7),
}
FIRST_M, RATIO, BAYS, LAUNCH = 4.0, 1.15, 12, 6.0
GREATEST_N, LEG_S = 480.0, 0.4
START_N, GROWTH, SEARCH_S, MOVES = 0.3, 1.4, 0.3, 0.12
EXPLORE_S, MORE, TOP, BOLD = 0.2, 0.25, 1.6, 1.6
LIGHTEST_KG, RISE = 1.0, 1.2
"""Least mass that the task allows, and the growth of the force while no mass is found."""
GRIP_S = 0.04
"""Way over speed of a cart that is gripped, at most; one that coasts to rest goes farther."""
CALLS, LEGS_AT_ONCE = 149, 3
TARGETS = (1.3, 1.8, 1.4, 0.9, 1.75, 1.5, 0.8, 0.4, 1.1, 1.8, 1.6, 1.8)


def _resistance(structure, knobs, v):
    """Resistance over mass at a speed above 0."""
    if structure == "air":
        more = knobs["gamma"] * v * v
    elif structure == "oil":
        more = knobs["beta"] * v
    else:
        more = knobs["eps"] * v / (1 + (v / knobs["w"]) ** 2)
    return knobs["dry"] * (1 + more)


def _rates(structure, knobs, time, state, force):
    """Time derivative of place and speed; the cart is never pushed backwards, and a step beyond rest is taken back."""
    v = np.maximum(state[1], 0.0)
    gain = force[0] / knobs["mass"] - _resistance(structure, knobs, v)
    return np.array([v, np.where((state[1] <= 0) & (gain < 0), -20 * state[1], gain)])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.003, 0.0075),
    longest_s=0.05,
    starts=300,
    tried=4,
    rounds=12,
)


def _course(readings):
    """Pushes and readings from the first motion on, while the guard is silent."""
    course = recorded(readings, [force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)])
    x, v = course.readings.T
    before, way = np.append(0.0, v[:-1]), np.diff(x, prepend=0.0)
    # A cart that the resistance alone brings to rest goes on for a while; one that the guard grips does not.
    gripped = (course.controls[:, 0] > 0) | (way < GRIP_S * before)
    held = np.nonzero((np.maximum.accumulate(v) > 0.4) & (v < 0.1) & gripped)[0]
    end = held[0] if len(held) else len(v)
    return type(course)(course.durations[:end], course.controls[:end], course.readings[:end])


def _way(structure, knobs):
    """Way from the launch to rest."""
    edges = np.linspace(0, LAUNCH, 4001)
    v = (edges[1:] + edges[:-1]) / 2
    return float(np.sum(v / _resistance(structure, knobs, v)) * (edges[1] - edges[0]))


def _bay(way):
    """Number of the bay of a place."""
    return str(int(np.clip(np.floor(np.log(way / FIRST_M) / np.log(RATIO)) + 1, 1, BAYS)))


def _best(readings):
    """Bay by the structure that fits best."""
    return _bay(_way(*LAWS.best(_course(readings))))


def _leg(push, lasting):
    return [
        call("apply_force", object_id="object_1", force_vector=[float(f"{push:.5g}"), 0, 0]),
        call("step", duration=lasting),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def _parts(v):
    """Columns of a sum of laws: constant, air, oil, and eddy current brakes of several kinds."""
    return np.stack([np.ones_like(v), v, v * v, *(v / (1 + (v / w) ** 2) for w in (0.8, 1.0, 1.25))], axis=-1)


def _mean(first, last):
    """Mean of the columns over a leg in which the speed changes evenly."""
    return (_parts(first) + 4 * _parts((first + last) / 2) + _parts(last)) / 6


def _guess(course):
    """Mass and sizes of the laws of a sum, from the legs in motion."""
    v = np.concatenate(([0.0], course.readings[:, 1]))
    first, last, dt = v[:-1], v[1:], course.durations[:, None]
    table = np.column_stack([last - first, _mean(first, last) * dt])
    moving = last > 0.06
    return nnls(table[moving], (course.controls[:, 0] * dt[:, 0])[moving])[0]


def _needed(p, v, target, lasting):
    """Force that brings the cart from a speed to another within a leg."""
    return float(p[0] * (target - v) / lasting + _mean(np.array(v), np.array(target)) @ p[1:])


def _plan(p, v, target, lasting):
    """The same force within the limits, and the speed to which it brings the cart."""
    push = _needed(p, v, target, lasting)
    if 0.0 <= push <= GREATEST_N:
        return push, target
    push = float(np.clip(push, 0.0, GREATEST_N))
    low, high = sorted((v, target))
    if (_needed(p, v, low, lasting) - push) * (_needed(p, v, high, lasting) - push) >= 0:
        return push, v
    return push, float(brentq(lambda last: _needed(p, v, last, lasting) - push, low, high))


def solve(task):
    """Increase the force in small steps until the cart moves, then vary its speed by pushes and free rolling."""
    seen, push = [], START_N
    while not seen or seen[-1][1]["velocity"][0] < MOVES:
        calls = []
        for _ in range(3):
            calls += _leg(push, SEARCH_S)
            push *= GROWTH
        seen += zip(calls, (yield calls), strict=True)
    calls = _leg(0, EXPLORE_S)
    while True:
        seen += zip(calls, (yield calls), strict=True)
        p, v = _guess(_course(seen)), max(seen[-1][1]["velocity"][0], 0.0)
        fastest = max(reading["velocity"][0] for _, reading in seen if "velocity" in reading)
        if fastest > TOP or len(seen) > 110:
            break
        target = min(fastest + MORE, TOP + 0.15)
        greatest = max(asked.arguments["force_vector"][0] for asked, _ in seen if asked.tool == "apply_force")
        # Legs with one force are explained by a friction alone, without a mass: then only another force tells more.
        push = min(_plan(p, v, target, EXPLORE_S)[0], BOLD * greatest) if p[0] > LIGHTEST_KG else RISE * greatest
        calls = [*_leg(push, EXPLORE_S), *_leg(0, EXPLORE_S)]
    number = 0
    while len(seen) + 4 <= CALLS:
        calls = []
        for _ in range(min(LEGS_AT_ONCE, (CALLS - len(seen)) // 4)):
            push, v = _plan(p, v, TARGETS[number % len(TARGETS)], LEG_S)
            calls += _leg(push, LEG_S)
            number += 1
        seen += zip(calls, (yield calls), strict=True)
        p, v = _guess(_course(seen)), max(seen[-1][1]["velocity"][0], 0.0)
    yield [answer(_best(seen))]


def fit(readings, structure):
    """Bay by the law of a structure."""
    return _bay(_way(structure, LAWS.fitted(_course(readings), structure)[1]))


def rivals(readings):
    """Each law of the resistance, fitted."""
    return members(LAWS, _course(readings), lambda law, knobs: _bay(_way(law, knobs)))


def structure(knobs):
    """Law of the resistance besides dry friction."""
    return knobs["kind"]


def _true(knobs):
    return {**knobs, "dry": knobs["dry"] / knobs["mass"]}


def theory(knobs):
    """The integral of speed over deceleration."""
    return _bay(_way(knobs["kind"], _true(knobs)))


def measure(engine, knobs):
    """The launch in the engine, without the guard."""
    free = engine.changed({"body[most].pos": (100.0, 0.0, 0.0)})
    free.set_velocity("object_1", np.array([LAUNCH, 0.0, 0.0]))
    for _ in range(free.whole_steps(200.0)):
        free.step(1)
        if abs(free.twist("object_1").linear[0]) < 1e-3:
            break
    return _bay(float(free.pose("object_1").position[0]))


def naive(knobs):
    """Dry friction alone; the resistance at 1.8 m/s all the way."""
    true = _true(knobs)
    top = float(_resistance(knobs["kind"], true, 1.8))
    return {
        "dry friction alone": _bay(LAUNCH**2 / 2 / true["dry"]),
        "resistance at 1.8 m/s": _bay(LAUNCH**2 / 2 / top),
    }


def stage(task):
    """Launch it by hand, and let it roll."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[LAUNCH, 0, 0]),
        call("step", duration=10.0),
        call("get_position", object_id="object_1"),
    ]
    yield [answer(_bay(readings[2]["position"][0]))]


def batch(task):
    """Forces in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(15) for asked in _leg(0.4 * 1.5**n, 0.8)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]
