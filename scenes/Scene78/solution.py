"""Scene 78: swing the wheel wider and wider below the latch, fit both parts of the torque, follow them around."""

import numpy as np

from scenes.courses import Channel, Laws, Predictor
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_a_side

TORQUE, LATCH = 5.0, 0.8
FOLDS = (2, 3, 4)
STRUCTURES = {f"{fold} times": ("i", "w", f"b{fold}") for fold in FOLDS}
BOX = {"i": (0.0005, 2.0), "w": (2.0, 60.0), "bend": (-60.0, 60.0), **{f"b{fold}": (-40.0, 40.0) for fold in FOLDS}}
"""Inertia; over it, the part of the torque that goes with the sine of the angle, and of a multiple of the angle."""
FAR = 0.4


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
    plain=("i", "w", "bend"),
)
"""The plain law has a torque that bends smoothly."""
RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 2)],
    [Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")],
    decimals=6,
)


def _course(readings):
    """The course up to where the latch caught."""
    course = RIG.course(readings)
    return course.until(abs(course.readings[:, 0]) > LATCH - 0.01)


def predict(structure, knobs):
    """Greatest torque around the wheel, and the spin with which it just gets around."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    angles = np.linspace(0.0, np.pi, 4001)
    torques = _back(knobs, angles)
    middles = (torques[1:] + torques[:-1]) / 2
    height = np.cumsum(middles * np.diff(angles)).max()
    return [float(knobs["i"] * abs(torques).max()), float((2 * height) ** 0.5)]


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.001, 0.004, 0.016, 0.064, 0.256, 1.0, 5.0),
    touch_s=0.15,
    moved=lambda reading: abs(reading[1]) > 0.05,
    strongest=lambda plan: min(TORQUE, 1.2 * plan.reach * plan.knobs["w"] * plan.knobs["i"]),
    worth=lambda plan, path: to_a_side(plan, path[:, 0], FAR, abs(path[:, 0])),
    span=lambda knobs: float(np.clip(0.9 / np.sqrt(knobs["w"]), 0.08, 0.36)),
    reaches=(0.12, 0.25, 0.4, 0.55, 0.65, 0.7, 0.73, 0.75),
    wider=lambda course: 0.04 + 1.8 * float(abs(course.readings[:, 0]).max()),
    time_s=12.8,
    fixed_pushes=(0.0015, 0.0, -0.005, 0.0, 0.015, 0.0, -0.05, 0.0, 0.15, 0.0, -0.5, 0.0, 1.5, 0.0, -5.0),
    fixed_s=0.4,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Each multiple of the angle, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def structure(knobs):
    """With which multiple of the angle the second part of the torque goes."""
    return f"{knobs['fold']} times"


def naive(knobs):
    """The sine alone, alike at small angles; in proportion to the angle."""
    stiff = knobs["w"] + knobs["fold"] * knobs["b"]
    return {
        "one sine": [knobs["i"] * stiff, 2 * stiff**0.5],
        "in proportion": [knobs["i"] * stiff * np.pi, stiff**0.5 * np.pi],
    }


def stage(task):
    """Turn as hard as possible; the latch catches the wheel."""
    readings = yield [*RIG.leg(TORQUE, 0.3), *RIG.leg(TORQUE, 0.3), *RIG.leg(TORQUE, 1.0)]
    yield [answer([TORQUE, max(abs(reading["angular_velocity"]) for reading in readings[3::4]) + 0.001])]


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
