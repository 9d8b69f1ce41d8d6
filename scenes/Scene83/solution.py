"""Scene 83: pump the bar to wider and wider swings below the pawl, fit, and integrate a turn."""

from math import pi

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Channel, Course, Laws, recorded, refined
from scenes.protocol import answer, call

PAWL, RAMP, TORQUE, SPIN = 1.6, 0.1, 12.0, 10.0
_COMMON = ("inertia", "square", "c", "begins")
STRUCTURES = {"oil": (*_COMMON, "c2"), "brushes": (*_COMMON, "q2"), "weight": (*_COMMON, "m2")}
PLAIN = ("inertia", "square", "c")
"""Constants with which the next torques are planned: what acts further up slows the bar only."""
BOX = {
    "inertia": (0.01, 6.0),
    "square": (1.5, 20.0),
    "c": (0.02, 1.0),
    "begins": (0.7, 1.2),
    "c2": (0.1, 3.0),
    "q2": (0.02, 1.0),
    "m2": (0.5, 40.0),
}
"""Moment of inertia; moment of weight, bearing and what acts further up over it."""
REACHES = (0.25, 0.5, 0.75, 1.0, 1.15, 1.3, 1.4, 1.48, 1.52)
"""How far the bar is let go in each iteration that has a model, in rad; the last one goes on."""
FAR, TIME_S, CALLS, ITERATIONS = 1.05, 20.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 7, 2, 300
TOUCHES, VISIBLE = (0.01, 0.1, 1.0), 0.08
"""First torques in N·m, each for 0.2 s, until the spin is seen, in rad/s."""


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
)


def _course(readings):
    """Torques, and angle and spin, up to where the pawl caught."""
    seen = [Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")]
    raw = recorded(readings, [Channel("apply_torque", "object_1", "torque_vector", 1)], seen)
    lost = np.nonzero(abs(raw.readings[:, 0]) > PAWL - 0.01)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants without what acts further up at points of the unit cube."""
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(PLAIN, unit, strict=True)}


def _roughly(course, unit):
    """The constants from one leg after the other, from a point of the unit cube or anywhere."""
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        ends = LAWS.advanced("plain", _constants(units), 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (2 * np.array(LAWS.sigma)[:, None])
        return np.vstack([np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1]), units - 0.5])

    if unit is None:
        units = np.random.default_rng(1).random((len(PLAIN), 400))
        unit = units[:, np.argmin(np.log1p(misfits(units) ** 2).sum(axis=0))]
        unit = refined(misfits, unit, 12)
    return refined(misfits, unit, 6)


def _planned(knobs, state, span, reach):
    """Torques for the next legs: of many at random, those that carry the bar far, but not beyond the reach."""
    rng = np.random.default_rng(2)
    strongest = min(TORQUE, 0.6 * min(reach, 1.0) * knobs["inertia"] * knobs["square"])
    torques = strongest * rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for torque in torques:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, torque[None, :])
            angle, spin = np.nan_to_num(states, nan=9.0)
            energy = spin**2 / 2 + knobs["square"] * (1 - np.cos(angle))
            value += (
                energy / knobs["square"]
                + 5 * np.maximum(abs(angle) - FAR, 0.0)
                - 1e3 * np.maximum(abs(angle) - reach, 0.0)
            )
    return torques[:LEGS, int(np.argmax(value))]


def _turn(torque, duration):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, round(float(torque), 4), 0]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Touches until the bar turns, then torques that the model so far chooses."""
    seen = []
    for torque in TOUCHES:
        calls = _turn(torque, 0.2)
        seen += zip(calls, (yield calls), strict=True)
        if _course(seen).readings[-1, 1] > VISIBLE:
            break
    calls = [*_turn(0.0, 0.3), *_turn(0.0, 0.3)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.2
    for _ in range(ITERATIONS - 4):
        course = _course(seen)
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(0.9 / np.sqrt(knobs["square"]), 0.1, 0.6))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.1 + 2 * wide), reaches[1:] or reaches
        calls = [asked for f in _planned(knobs, course.readings[-1], span, reach) for asked in _turn(f, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _predict(structure, knobs):
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


def fit(readings, structure):
    """Both spins by what acts further up in a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """What acts further up."""
    return knobs["kind"]


def theory(knobs):
    """The full turn by its equation of motion."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """Nothing further up; nothing brakes at all."""
    free = {**knobs, "c2": 1e-9}
    return {"nothing further up": _predict("oil", free), "no brake": _predict("oil", {**free, "c": 1e-9})}


def stage(task):
    """Turn as hard as possible, and read the largest spin."""
    calls = [asked for _ in range(4) for asked in _turn(TORQUE, 0.2)]
    readings = yield calls
    spin = max(abs(reading["angular_velocity"]) for reading in readings if reading.get("angular_velocity") is not None)
    yield [answer([spin, spin])]


def batch(task):
    """Torques to and fro, stronger and stronger, and the same fit."""
    torques = (0.01, 0.0, -0.03, 0.06, -0.1, 0.15, -0.3, 0.4, -0.8, 1.0, -2.0, 3.0, -5.0, 8.0, -12.0)
    calls = [asked for torque in torques for asked in _turn(torque, 0.6)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """The full turn in the engine, without the pawl."""
    free = engine.changed({"body[pawl].pos": (0.0, 0.0, 0.0), "key[start].qvel": SPIN})
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
