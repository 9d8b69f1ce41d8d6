"""Scene 78: swing the wheel wider and wider below the latch, fit both parts of the torque, follow them around."""

import numpy as np

from scenes.courses import Channel, Course, Laws, recorded, refined
from scenes.protocol import answer, call

TORQUE, LATCH = 5.0, 0.8
FOLDS = (2, 3, 4)
STRUCTURES = {f"{fold} times": ("i", "w", f"b{fold}") for fold in FOLDS}
PLAIN = ("i", "w", "bend")
"""Constants of a torque that bends smoothly, with which the next torques are planned."""
BOX = {"i": (0.0005, 2.0), "w": (2.0, 60.0), "bend": (-60.0, 60.0), **{f"b{fold}": (-40.0, 40.0) for fold in FOLDS}}
"""Inertia; over it, the part of the torque that goes with the sine of the angle, and of a multiple of the angle."""
REACHES = (0.12, 0.25, 0.4, 0.55, 0.65, 0.7, 0.73, 0.75)
"""How far the wheel is let go in each iteration that has a model, in rad; the last one goes on."""
FAR, TIME_S, CALLS, ITERATIONS = 0.4, 12.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 3, 5, 3, 300
TOUCHES, VISIBLE, TOUCH_S = (0.001, 0.004, 0.016, 0.064, 0.256, 1.0, 5.0), 0.05, 0.15
"""First torques in N·m until the spin is seen, in rad/s."""


def _back(knobs, angle):
    """Torque towards angle 0 over the inertia."""
    torque = knobs["w"] * np.sin(angle) + knobs.get("bend", 0.0) * angle**3
    for fold in FOLDS:
        if f"b{fold}" in knobs:
            torque = torque + knobs[f"b{fold}"] * np.sin(fold * angle)
    return torque


def _rates(structure, knobs, time, state, control):
    """Time derivative of angle and spin."""
    angle, spin = np.clip(state, -50.0, 50.0)
    return np.array([spin, control[0] / knobs["i"] - _back(knobs, angle)])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.00101, 0.00202),
    longest_s=0.025,
    starts=120,
    tried=3,
    rounds=10,
)


def _course(readings):
    """Torques, angles and spins, up to where the latch caught."""
    seen = Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")
    raw = recorded(readings, [Channel("apply_torque", "object_1", "torque_vector", 2)], seen)
    lost = np.nonzero(abs(raw.readings[:, 0]) > LATCH - 0.01)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants of a torque that bends smoothly at points of the unit cube."""
    ends = [(*BOX[name], part) for name, part in zip(PLAIN, unit, strict=True)]
    return {
        name: low * (high / low) ** part if low > 0 else low + (high - low) * part
        for name, (low, high, part) in zip(PLAIN, ends, strict=True)
    }


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


def _planned(knobs, state, span, reach, side):
    """Torques for the next legs: of many at random, those that turn the wheel to a side, within the reach."""
    rng = np.random.default_rng(2)
    strongest = min(TORQUE, 1.2 * reach * knobs["w"] * knobs["i"])
    torques = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for held in torques:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held[None, :])
            place = np.nan_to_num(abs(states[0]), nan=9.0)
            value += 10 * np.maximum(np.minimum(side * states[0], reach) - FAR, 0.0) + place
            value -= 1e3 * np.maximum(place - reach, 0.0)
    return torques[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, round(float(strength), 6)]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Touches until the wheel turns, then torques that the model so far chooses."""
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
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(0.9 / np.sqrt(knobs["w"]), 0.08, 0.5))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.04 + 1.8 * wide), reaches[1:] or reaches
        planned = _planned(knobs, course.readings[-1], span, reach, (-1) ** (number // 2))
        calls = [asked for strength in planned for asked in _push(strength, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _predict(structure, knobs):
    """Greatest torque around the wheel, and the spin with which it just gets around."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    angles = np.linspace(0.0, np.pi, 4001)
    torques = _back(knobs, angles)
    middles = (torques[1:] + torques[:-1]) / 2
    height = np.cumsum(middles * np.diff(angles)).max()
    return [float(knobs["i"] * abs(torques).max()), float((2 * height) ** 0.5)]


def fit(readings, structure):
    """The answer by the torque of a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """With which multiple of the angle the second part of the torque goes."""
    return f"{knobs['fold']} times"


def theory(knobs):
    """The torque around the wheel, and its work."""
    return _predict(structure(knobs), {**knobs, f"b{knobs['fold']}": knobs["b"]})


def naive(knobs):
    """The sine alone, alike at small angles; in proportion to the angle."""
    stiff = knobs["w"] + knobs["fold"] * knobs["b"]
    return {
        "one sine": [knobs["i"] * stiff, 2 * stiff**0.5],
        "in proportion": [knobs["i"] * stiff * np.pi, stiff**0.5 * np.pi],
    }


def stage(task):
    """Turn as hard as possible; the latch catches the wheel."""
    readings = yield [*_push(TORQUE, 0.3), *_push(TORQUE, 0.3), *_push(TORQUE, 1.0)]
    yield [answer([TORQUE, max(abs(reading["angular_velocity"]) for reading in readings[3::4]) + 0.001])]


def batch(task):
    """Torques to and fro, stronger and stronger, and the same fit."""
    torques = (0.0015, 0.0, -0.005, 0.0, 0.015, 0.0, -0.05, 0.0, 0.15, 0.0, -0.5, 0.0, 1.5, 0.0, -5.0)
    calls = [asked for torque in torques for asked in _push(torque, 0.4)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """Without latch: the change of spin in a step from rest all around; the spin by trial."""
    torques = []
    for angle in np.linspace(0.02, np.pi, 60):
        free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qpos": (float(angle),)})
        free.step(1)
        torques.append(abs(float(free.turn("object_1").spin)) * free.whole_steps(1.0) * knobs["i"])
    low, high = 0.5, 40.0
    for _ in range(16):
        spin = (low + high) / 2
        free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qvel": (spin,)})
        while 0 <= free.turn("object_1").angle < 3.3 and free.turn("object_1").spin > 0:
            free.step(1)
        low, high = (low, spin) if free.turn("object_1").angle >= 3.3 else (spin, high)
    return [max(torques), spin]
