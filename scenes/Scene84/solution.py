"""Scene 84: let the drum tilt wider and wider below the latch, fit table, rotor and springs, balance the torques."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from scenes.courses import Channel, Course, Laws, recorded, refined
from scenes.protocol import answer, call

TURN, BLOW, TORQUE, LATCH = 10.0, 6.0, 10.0, 0.35
_COMMON = ("i", "j", "h", "w")
STRUCTURES = {
    "second": (*_COMMON, "more", "begins"),
    "thick second": (*_COMMON, "more", "begins", "c"),
    "stiff": (*_COMMON, "bend"),
    "thick stiff": (*_COMMON, "bend", "c"),
}
PLAIN = (*_COMMON, "bend", "c")
"""Constants with which the next torques are planned."""
BOX = {
    "i": (0.001, 3.0),
    "j": (0.05, 0.8),
    "h": (0.5, 15.0),
    "w": (3.0, 40.0),
    "more": (2.0, 200.0),
    "begins": (0.1, 0.27),
    "bend": (2.0, 200.0),
    "c": (0.05, 6.0),
}
"""Inertia of table and drum; of the drum over it; angular momentum of the rotor, stiffness, further or cubed stiffness,
and resistance over the inertia of the drum; angle from which on there is a further spring."""
REACHES = (0.08, 0.14, 0.2, 0.25, 0.28, 0.3, 0.315, 0.325)
"""How far the drum is let go in each iteration that has a model, in rad; the last one goes on."""
FAR, TIME_S, CALLS, ITERATIONS = 0.2, 12.4, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 5, 3, 300
TOUCHES, VISIBLE, TOUCH_S = (0.002, 0.008, 0.032, 0.128, 0.512, 2.0, 8.0), 0.03, 0.15
"""First torques in N·m until the spin of the table is seen, in rad/s."""


def _back(knobs, tilt):
    """Torque of the springs over the inertia of the drum."""
    torque = knobs["w"] * tilt
    if "more" in knobs:
        return torque + knobs["more"] * np.sign(tilt) * np.maximum(abs(tilt) - knobs["begins"], 0.0)
    return torque + knobs["bend"] * tilt**3


def _rates(structure, knobs, time, state, control):
    """Time derivative of the tilt, the spin of the table and the rate of the tilt."""
    tilt, spin, rate = np.clip(state, -50.0, 50.0)
    swept = knobs["h"] * np.cos(tilt)
    slow = knobs["c"] * rate if "c" in knobs else 0.0
    return np.array(
        [rate, control[0] / knobs["i"] - knobs["j"] * swept * rate, swept * spin - _back(knobs, tilt) - slow]
    )


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0),
    sigma=(0.0004, 0.0016, 0.0016),
    longest_s=0.04,
    starts=150,
    tried=3,
    rounds=8,
)


def _course(readings):
    """Torques, and tilt, spin and rate, up to where the latch caught."""
    seen = [
        Channel("get_position", "object_2", "angle"),
        Channel("get_velocity", "object_1", "angular_velocity"),
        Channel("get_velocity", "object_2", "angular_velocity"),
    ]
    raw = recorded(readings, [Channel("apply_torque", "object_1", "torque_vector", 2)], seen)
    lost = np.nonzero(abs(raw.readings[:, 0]) > LATCH - 0.003)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants of a stiffening spring in oil at points of the unit cube."""
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


def _planned(knobs, state, span, reach, side):
    """Torques for the next legs: of many at random, those that tilt the drum to a side, within the reach."""
    rng = np.random.default_rng(2)
    strongest = min(TORQUE, 1.2 * reach * knobs["w"] / knobs["h"] * knobs["i"] / span)
    torques = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for held in torques:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held[None, :])
            tilt = np.nan_to_num(abs(states[0]), nan=9.0)
            value += 10 * np.maximum(np.minimum(side * states[0], reach) - FAR, 0.0) + tilt
            value -= 1e3 * np.maximum(tilt - reach, 0.0)
    return torques[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, round(float(strength), 6)]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_1"),
        call("get_velocity", object_id="object_2"),
    ]


def solve(task):
    """Touches until the table turns, then torques that the model so far chooses."""
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
        span = float(np.clip(0.9 / np.sqrt(knobs["w"] + knobs["h"] ** 2 * knobs["j"]), 0.08, 0.5))
        spent += LEGS * span
        if len(seen) + 5 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.04 + 2 * wide), reaches[1:] or reaches
        planned = _planned(knobs, course.readings[-1], span, reach, (-1) ** (number // 2))
        calls = [asked for torque in planned for asked in _push(torque, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _torque(knobs, tilt):
    """Torque of the springs that balances the rotor in steady turning."""
    return float(knobs["i"] * knobs["j"] * knobs["h"] * TURN * np.cos(tilt))


def _predict(structure, knobs):
    """Tilt and torque of the springs in steady turning, and the greatest tilt after a blow."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    steady = brentq(lambda tilt: knobs["h"] * TURN * np.cos(tilt) - float(_back(knobs, tilt)), 0.0, np.pi / 2)

    def turns(time, state):
        return state[2] if time > 0 else 1.0

    turns.terminal, turns.direction = True, -1
    blow = solve_ivp(
        lambda time, state: _rates(structure, knobs, time, state, [0.0]),
        (0, 30),
        [0.0, BLOW, 0.0],
        events=turns,
        rtol=1e-8,
        atol=1e-9,
    )
    return [float(steady), _torque(knobs, steady), float(blow.y[0, -1])]


def fit(readings, structure):
    """Both tilts by the springs of a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """Which springs hold the drum, and whether in oil."""
    return knobs["kind"]


def theory(knobs):
    """The balance of torques, and the motion after the blow."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """The springs of small tilts; these, and the tilt in proportion to the turning."""
    small = _predict("stiff", {**knobs, "bend": 0.0})
    ratio = knobs["h"] * TURN / knobs["w"]
    return {"springs of small tilts": small, "in proportion": [ratio, _torque(knobs, 0.0), 2 * ratio]}


def stage(task):
    """Turn as hard as possible, and read the tilt."""
    calls = [asked for strength in (TORQUE, TORQUE, 0.0, 0.0) for asked in _push(strength, 0.3)]
    readings = yield calls
    tilt = max(abs(reading["angle"]) for reading in readings if reading.get("angle") is not None)
    yield [answer([tilt, TORQUE, tilt])]


def batch(task):
    """Torques to and fro, stronger and stronger, and the same fit."""
    torques = (0.003, -0.006, 0.012, -0.024, 0.05, -0.1, 0.2, -0.4, 0.8, -1.6, 4.0, -8.0)
    calls = [asked for torque in torques for asked in _push(torque, 0.35)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """Without latch: where the drum of a table that nothing can slow does not speed up; the course after the blow."""
    low, high = 0.0, np.pi / 2
    heavy = {"body[latch].pos": (0.0, 0.0, 0.0), "body[object_1]/inertial.diaginertia": (1e7, 1e7, 1e7)}
    for _ in range(22):
        tilt = (low + high) / 2
        free = engine.changed({**heavy, "key[start].qpos": (0.0, tilt), "key[start].qvel": (TURN, 0.0)})
        free.step(1)
        low, high = (tilt, high) if free.turn("object_2").spin > 0 else (low, tilt)
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qvel": (BLOW, 0.0)})
    path = [0.0]
    while len(path) < 3 or path[-1] >= path[-2]:
        free.step(1)
        path.append(float(free.turn("object_2").angle))
    return [tilt, _torque(knobs, tilt), path[-2]]
