"""Scene 83: pump the bar to wider and wider swings below the pawl, fit, and integrate a turn."""

from functools import partial
from math import pi

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Channel, Laws, Predictor
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_and_fro

PAWL, RAMP, TORQUE, SPIN = 1.6, 0.1, 12.0, 10.0
_COMMON = ("inertia", "square", "c", "begins")
STRUCTURES = {"oil": (*_COMMON, "c2"), "brushes": (*_COMMON, "q2"), "weight": (*_COMMON, "m2")}
BOX = {
    "inertia": (0.01, 6.0),
    "square": (1.5, 20.0),
    "c": (0.02, 1.0),
    "begins": (0.8, 1.1),
    "c2": (0.1, 3.0),
    "q2": (0.02, 1.0),
    "m2": (0.5, 40.0),
}
"""Moment of inertia; moment of weight, bearing and what acts further up over it."""
FAR = 1.05


def _rates(structure, knobs, time, state, control):
    """Time derivative of angle and spin."""
    angle, spin = np.clip(state, -100.0, 100.0)
    brake = knobs["c"] * spin
    if "begins" in knobs:
        turned = abs(angle) % (2 * np.pi)
        there = np.clip((np.minimum(turned, 2 * np.pi - turned) - knobs["begins"]) / RAMP, 0.0, 1.0)
        brake = brake + there * (knobs.get("c2", 0.0) + knobs.get("q2", 0.0) * abs(spin)) * spin
        brake = brake + np.clip((abs(angle) - knobs["begins"]) / RAMP, 0.0, 1.0) * knobs.get("m2", 0.0) * np.sign(angle)
    return np.array([spin, control[0] / knobs["inertia"] - knobs["square"] * np.sin(angle) - brake])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.0012, 0.0045),
    longest_s=0.035,
    starts=150,
    tried=3,
    rounds=6,
    plain=("inertia", "square", "c"),
)
"""The plain law lacks what acts further up, which slows the bar only."""
RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 1)],
    [Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")],
)


def _course(readings):
    """The course up to where the pawl caught."""
    course = RIG.course(readings)
    kept = course.until(abs(course.readings[:, 0]) > PAWL)
    return kept if kept.count else course


def predict(structure, knobs):
    """Spin at the top and after a full turn; 0 where the bar does not get there."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    def top(time, state):
        return state[0] - pi

    def bottom(time, state):
        return state[0] - 2 * pi

    bottom.terminal = True
    spins = solve_ivp(rates, (0, 8), [0.0, SPIN], events=(top, bottom), rtol=1e-8, atol=1e-9).y_events
    return [float(states[0][1]) if len(states) else 0.0 for states in spins]


def _worth(plan, path):
    """Much energy and wide swings, within the reach."""
    angle, spin, square = path[:, 0], path[:, 1], plan.knobs["square"]
    energy = spin**2 / 2 + square * (1 - np.cos(angle))
    wide = 5 * np.maximum(abs(angle) - FAR, 0.0) - 1e3 * np.maximum(abs(angle) - plan.reach, 0.0)
    return (energy / square + wide).sum(axis=0)


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.01, 0.1, 1.0),
    moved=lambda reading: reading[1] > 0.08,
    settled=lambda _: ((0.0, 0.3), (0.0, 0.3)),
    strongest=lambda plan: min(TORQUE, 0.6 * min(plan.reach, 1.0) * plan.knobs["inertia"] * plan.knobs["square"]),
    pattern=partial(to_and_fro, shares=(-1.0, -0.5, 0.0, 0.5, 1.0)),
    worth=_worth,
    span=lambda knobs: float(np.clip(0.9 / np.sqrt(knobs["square"]), 0.1, 0.6)),
    reaches=(0.25, 0.5, 0.75, 1.0, 1.15, 1.3, 1.4, 1.48, 1.52),
    wider=lambda course: 0.1 + 2 * float(abs(course.readings[:, 0]).max()),
    rounds=15,
    legs=2,
    ahead=7,
    looks=2,
    time_s=18.8,
    fixed_pushes=(0.01, 0.0, -0.03, 0.06, -0.1, 0.15, -0.3, 0.4, -0.8, 1.0, -2.0, 3.0, -5.0, 8.0, -12.0),
    fixed_s=0.6,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Oil, brushes and weight, fitted."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """Nothing further up; nothing brakes at all."""
    free = {**knobs, "c2": 1e-9}
    return {"nothing further up": predict("oil", free), "no brake": predict("oil", {**free, "c": 1e-9})}


def stage(task):
    """Turn as hard as possible, and read the largest spin."""
    calls = [asked for _ in range(4) for asked in RIG.leg(TORQUE, 0.2)]
    readings = yield calls
    spin = max(abs(reading["angular_velocity"]) for reading in readings if reading.get("angular_velocity") is not None)
    yield [answer([spin, spin])]


def measure(engine, knobs):
    """The full turn in the engine, without the pawl."""
    free = engine.changed({"body[pawl].pos": (0.0, 0.0, 0.0), "key[start].qvel": (SPIN, 0.0)})
    spins, before = [], free.turn("object_1")
    for goal in (pi, 2 * pi):
        now = before
        while now.angle < goal:
            before = now
            free.step(1)
            now = free.turn("object_1")
        share = (goal - before.angle) / (now.angle - before.angle)
        spins.append(before.spin + share * (now.spin - before.spin))
        before = now
    return spins
