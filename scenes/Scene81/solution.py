"""Scene 81: let the crate sway wider and wider below the pawl, fit trolley, crate and springs, balance the torques."""

from dataclasses import replace
from math import cos, sin

import numpy as np

from scenes.courses import Channel, Laws, Predictor, force, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_a_side

LEAN, FORCE, PAWL, GRAVITY = 0.6, 10.0, 0.3, 9.81
_COMMON = ("total", "e", "l", "kappa")
STRUCTURES = {
    "plus": (*_COMMON, "more_plus", "from_plus"),
    "minus": (*_COMMON, "more_minus", "from_minus"),
    "both": (*_COMMON, "more_plus", "from_plus", "more_minus", "from_minus"),
}
BOX = {
    "total": (0.03, 30.0),
    "e": (0.03, 0.6),
    "l": (0.2, 1.2),
    "kappa": (1.0, 30.0),
    "more_plus": (0.8, 5.0),
    "more_minus": (0.8, 5.0),
    "from_plus": (0.13, 0.21),
    "from_minus": (0.13, 0.21),
    "bend": (0.1, 600.0),
}
"""Mass of both; moment of the crate's mass over it; inertia, and stiffness less the weight, over this moment; stiffness
of a further spring over this one."""
FAR, HUGE_KG = 0.18, 1e7


def _back(knobs, angle):
    """Torque towards the upright, less that of the weight at small angles, over the moment of mass."""
    torque = (knobs["kappa"] + GRAVITY) * angle + knobs.get("bend", 0.0) * angle**3
    for side, name in ((1, "plus"), (-1, "minus")):
        if f"more_{name}" in knobs:
            further = np.maximum(side * angle - knobs[f"from_{name}"], 0.0)
            torque = torque + side * knobs["kappa"] * knobs[f"more_{name}"] * further
    return torque


def _rates(structure, knobs, time, state, control):
    """Time derivative of angle, speed of the trolley and spin."""
    angle, _, spin = np.clip(state, -50.0, 50.0)
    c, s, e = np.cos(angle), np.sin(angle), knobs["e"]
    pushed = control[0] / knobs["total"] + e * spin**2 * s
    turn = (GRAVITY * s - _back(knobs, angle) - c * pushed) / np.maximum(knobs["l"] - e * c**2, 0.02)
    return np.array([spin, pushed - e * turn * c, turn])


def _laws(longest_s, starts, tried):
    """The laws, integrated in steps of a length."""
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box=BOX,
        start=(0.0, 0.0, 0.0),
        sigma=(0.0003, 0.0018, 0.0012),
        longest_s=longest_s,
        starts=starts,
        tried=tried,
        rounds=8,
        plain=(*_COMMON, "bend"),
    )


LAWS, FINE = _laws(0.035, 150, 3), _laws(0.015, 120, 2)
"""Long steps do for planning; the last fit needs short ones, since the torque has corners."""
ROUGH = LegFit(LAWS)


RIG = Rig(
    [force("object_1", 0)],
    [
        Channel("get_position", "object_2", "angle"),
        velocity("object_1", 0),
        Channel("get_velocity", "object_2", "angular_velocity"),
    ],
)


def _course(readings):
    """The course up to where the pawl caught."""
    course = RIG.course(readings)
    return course.until(abs(course.readings[:, 0]) > PAWL - 0.003)


def _own(structure, knobs):
    """The constants of a structure alone."""
    return {name: float(knobs[name]) for name in STRUCTURES[structure]}


def predict(structure, knobs):
    """Accelerations at which the crate leans so far to either side."""
    torques = [side * float(_back(_own(structure, knobs), side * LEAN)) for side in (-1, 1)]
    return [(torque - GRAVITY * sin(LEAN)) / cos(LEAN) for torque in torques]


def _worth(plan, path):
    """Leans to the side that has leaned less far, within the reach; the trolley should not drift away."""
    lean, speed, spin = path.transpose(1, 0, 2)
    speeds = np.append(0.0, plan.course.readings[:, 1])
    start = (plan.course.durations * (speeds[1:] + speeds[:-1]) / 2).sum()
    place = start + plan.look * speed.sum(axis=0)
    drift = np.maximum(abs(place + 2 * (speed[-1] + plan.knobs["e"] * spin[-1])) - 3.0, 0.0)
    minus, plus = (np.maximum(side * plan.course.readings[:, 0] - FAR, 0.0).sum() for side in (-1, 1))
    plan = replace(plan, side=plan.side if minus == plus else int(np.sign(minus - plus)))
    return to_a_side(plan, lean, FAR, abs(lean)) - 3 * drift


SWING = Swing(
    rig=RIG,
    model=Predictor(FINE, _course, predict),
    rough=ROUGH,
    touches=(0.02, 0.1, 0.5, 2.5),
    moved=lambda reading: abs(reading[1]) > 0.015,
    strongest=lambda plan: min(FORCE, 1.2 * plan.reach * plan.knobs["kappa"] * plan.knobs["total"]),
    worth=_worth,
    span=lambda knobs: float(np.clip(0.9 * np.sqrt(max(knobs["l"] - knobs["e"], 0.05) / knobs["kappa"]), 0.08, 0.5)),
    reaches=(0.06, 0.12, 0.18, 0.22, 0.24, 0.26, 0.275, 0.285),
    wider=lambda course: 0.03 + 2 * float(abs(course.readings[:, 0]).max()),
    legs=2,
    time_s=10.8,
    fixed_pushes=(0.02, -0.05, 0.1, -0.2, 0.5, -1.0, 2.0, -4.0, 8.0, -10.0, 5.0, 0.0),
    fixed_s=0.35,
    # The law for planning is as stiff on one side as on the other, so by itself it lets the pawl catch the crate.
    plausible=lambda course: ROUGH.plausible(course, 4.0),
    limit=0.285,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Further springs on one side, the other, or both, fitted."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """The springs near the upright; the weight left out."""
    alone = ((knobs["kappa"] + GRAVITY) * LEAN - GRAVITY * sin(LEAN)) / cos(LEAN)
    light = [side / cos(LEAN) * float(_back(_own(knobs["kind"], knobs), side * LEAN)) for side in (-1, 1)]
    return {"springs near the upright": [alone, alone], "without weight": light}


def stage(task):
    """Push as hard as possible, one way and the other, and carry the leans on in proportion."""
    found = []
    for strength in (FORCE, -FORCE):
        calls = [*RIG.leg(strength, 0.1), *RIG.leg(0, 0.1)]
        readings = yield calls
        lean = max(abs(reading["angle"]) for reading in readings if reading.get("angle") is not None)
        found.append(abs(readings[3]["velocity"][0]) / 0.1 * LEAN / max(lean, 0.001))
    yield [answer(found)]


def _driven(engine, angle, force, **changes):
    """The crate at an angle on a trolley of a huge mass under a constant force, without pawl and nets."""
    free = engine.changed(
        {
            "body[pawl].pos": (0.0, 0.0, 0.0),
            "joint[object_2_joint].range": (-500.0, 500.0),
            "body[object_1]/inertial.mass": HUGE_KG,
            "key[start].qpos": (0.0, angle),
            **changes,
        }
    )
    free.push("object_1", force=np.array([force, 0.0, 0.0]))
    return free


def settles(engine, knobs, off):
    """Both leans under constant accelerations, let go a little off; a weak brake at the hinge calms the crate."""
    left, brake = [], 0.3 * knobs["q"] * knobs["l"] * knobs["own"]
    for side, rate in zip((-1, 1), predict(knobs["kind"], knobs), strict=True):
        force = -side * rate * (HUGE_KG + knobs["mass"])
        free = _driven(engine, side * LEAN * (1 + off), force, **{"joint[object_2_joint].damping": brake})
        free.step(free.whole_steps(25.0))
        left.append(free.turn("object_2").angle / (side * LEAN) - 1)
    return max(left, key=abs)


def measure(engine, knobs):
    """The acceleration at which the crate does not begin to turn, on a trolley that a huge mass keeps to it."""
    found = []
    for side, theory_of in zip((-1, 1), predict(knobs["kind"], knobs), strict=True):
        low, high = 0.3 * theory_of, 2.0 * theory_of
        for _ in range(25):
            rate = (low + high) / 2
            free = _driven(engine, side * LEAN, -side * rate * (HUGE_KG + knobs["mass"]))
            free.step(2)
            low, high = (rate, high) if side * free.turn("object_2").spin < 0 else (low, rate)
        found.append((low + high) / 2)
    return found
