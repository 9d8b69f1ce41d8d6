"""Scene 81: let the crate sway wider and wider below the pawl, fit trolley, crate and springs, balance the torques."""

from math import cos, sin

import numpy as np

from scenes.courses import Channel, Course, Laws, force, recorded, refined, velocity
from scenes.protocol import answer, call

LEAN, FORCE, PAWL, GRAVITY = 0.6, 10.0, 0.3, 9.81
_COMMON = ("total", "e", "l", "kappa")
STRUCTURES = {
    "plus": (*_COMMON, "pp", "from_plus"),
    "minus": (*_COMMON, "pm", "from_minus"),
    "both": (*_COMMON, "pp", "from_plus", "pm", "from_minus"),
}
PLAIN = (*_COMMON, "bend")
"""Constants with a torque that bends smoothly, with which the next forces are planned."""
BOX = {
    "total": (0.03, 30.0),
    "e": (0.03, 0.6),
    "l": (0.2, 1.2),
    "kappa": (1.0, 30.0),
    "pp": (1.0, 150.0),
    "pm": (1.0, 150.0),
    "from_plus": (0.1, 0.25),
    "from_minus": (0.1, 0.25),
    "bend": (0.1, 600.0),
}
"""Mass of both; moment of the crate's mass over it; inertia, and stiffness less the weight, over this moment."""
REACHES = (0.06, 0.12, 0.18, 0.22, 0.24, 0.26, 0.275, 0.285)
"""How far the crate is let go in each iteration that has a model, in rad; the last one goes on."""
FAR, TIME_S, CALLS, ITERATIONS = 0.18, 12.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 5, 3, 300
TOUCHES, VISIBLE = (0.02, 0.1, 0.5, 2.5), 0.015
"""First forces in N, each for 0.2 s, until the speed is seen, in m/s."""


def _back(knobs, angle):
    """Torque towards the upright, less that of the weight at small angles, over the moment of mass."""
    torque = (knobs["kappa"] + GRAVITY) * angle + knobs.get("bend", 0.0) * angle**3
    if "pp" in knobs:
        torque = torque + knobs["pp"] * np.maximum(angle - knobs["from_plus"], 0.0)
    if "pm" in knobs:
        torque = torque - knobs["pm"] * np.maximum(-angle - knobs["from_minus"], 0.0)
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
    )


LAWS, FINE = _laws(0.035, 150, 3), _laws(0.015, 120, 2)
"""Long steps do for planning; the last fit needs short ones, since the torque has corners."""


def _course(readings):
    """Forces, and angle, speed and spin, up to where the pawl caught."""
    seen = [
        Channel("get_position", "object_2", "angle"),
        velocity("object_1", 0),
        Channel("get_velocity", "object_2", "angular_velocity"),
    ]
    raw = recorded(readings, [force("object_1", 0)], seen)
    lost = np.nonzero(abs(raw.readings[:, 0]) > PAWL - 0.003)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants of a smooth torque at points of the unit cube."""
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


def _planned(knobs, course, span, reach, side):
    """Forces for the next legs: of many at random, those that make it lean to a side, within the reach."""
    rng = np.random.default_rng(2)
    strongest = min(FORCE, 1.2 * reach * knobs["kappa"] * knobs["total"])
    forces = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = course.readings[-1][:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    speeds = np.append(0.0, course.readings[:, 1])
    place = (course.durations * (speeds[1:] + speeds[:-1]) / 2).sum()
    for held in forces:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held[None, :])
            lean = np.nan_to_num(abs(states[0]), nan=9.0)
            place = place + span / LOOKS * states[1]
            value += (
                10 * np.maximum(np.minimum(side * states[0], reach) - FAR, 0.0)
                + lean
                - 1e3 * np.maximum(lean - reach, 0.0)
            )
    value -= 3 * np.maximum(abs(place + 2 * (states[1] + knobs["e"] * states[2])) - 3.0, 0.0)
    return forces[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_force", object_id="object_1", force_vector=[round(float(strength), 4), 0, 0]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_1"),
        call("get_velocity", object_id="object_2"),
    ]


def solve(task):
    """Touches until the trolley moves, then forces that the model so far chooses."""
    seen = []
    for strength in TOUCHES:
        calls = _push(strength, 0.2)
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
        span = float(np.clip(0.9 * np.sqrt(max(knobs["l"] - knobs["e"], 0.05) / knobs["kappa"]), 0.08, 0.5))
        spent += LEGS * span
        if len(seen) + 5 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.03 + 2 * wide), reaches[1:] or reaches
        planned = _planned(knobs, course, span, reach, (-1) ** (number // 2))
        calls = [asked for f in planned for asked in _push(f, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*FINE.best(_course(seen))))]


def _predict(structure, knobs):
    """Accelerations at which the crate leans so far to either side."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    torques = [side * float(_back(knobs, side * LEAN)) for side in (-1, 1)]
    return [(torque - GRAVITY * sin(LEAN)) / cos(LEAN) for torque in torques]


def fit(readings, structure):
    """Both accelerations by the springs of a structure."""
    return _predict(structure, FINE.fitted(_course(readings), structure)[1])


def structure(knobs):
    """On which side there is a further spring."""
    return knobs["kind"]


def theory(knobs):
    """Both accelerations from the balance of torques."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """The springs near the upright; the weight left out."""
    alone = ((knobs["kappa"] + GRAVITY) * LEAN - GRAVITY * sin(LEAN)) / cos(LEAN)
    light = [side / cos(LEAN) * float(_back(knobs, side * LEAN)) for side in (-1, 1)]
    return {"springs near the upright": [alone, alone], "without weight": light}


def stage(task):
    """Push as hard as possible, one way and the other, and carry the leans on in proportion."""
    found = []
    for strength in (FORCE, -FORCE):
        calls = [*_push(strength, 0.1), *_push(0, 0.1)]
        readings = yield calls
        lean = max(abs(reading["angle"]) for reading in readings if reading.get("angle") is not None)
        found.append(abs(readings[3]["velocity"][0]) / 0.1 * LEAN / max(lean, 0.001))
    yield [answer(found)]


def batch(task):
    """Pushes to and fro, stronger and stronger, and the same fit."""
    forces = (0.02, -0.05, 0.1, -0.2, 0.5, -1.0, 2.0, -4.0, 8.0, -10.0, 5.0, 0.0)
    calls = [asked for f in forces for asked in _push(f, 0.35)]
    readings = yield calls
    yield [answer(_predict(*FINE.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """The force that holds the trolley under the leaning crate at a standstill, with gravity along x besides.

    An accelerated trolley is the same as one at rest with gravity towards its rear. The trolley is held by a huge mass.
    """
    found = []
    for side, theory_of in zip((-1, 1), theory(knobs), strict=True):
        changes = {"body[pawl].pos": (0.0, 0.0, 0.0), "joint[object_2_joint].range": (-500.0, 500.0)}
        free = engine.changed({**changes, "body[object_1]/inertial.mass": 1e7})
        low, high = 0.3 * theory_of, 2.0 * theory_of
        for _ in range(25):
            rate = (low + high) / 2
            free = free.changed({"key[start].qpos": (0.0, side * LEAN)})
            free.push("object_1", force=np.array([-side * rate * (1e7 + knobs["mass"]), 0.0, 0.0]))
            free.step(2)
            low, high = (rate, high) if side * free.turn("object_2").spin < 0 else (low, rate)
        found.append((low + high) / 2)
    return found
