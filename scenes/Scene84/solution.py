"""Scene 84: let the drum tilt wider and wider below the latch, fit table, rotor and springs, balance the torques."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from scenes.courses import Channel, Laws, Predictor
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_a_side

TURN, BLOW, TORQUE, LATCH = 10.0, 6.0, 10.0, 0.35
_COMMON = ("i", "j", "h", "w")
STRUCTURES = {
    "second": (*_COMMON, "more", "begins"),
    "thick second": (*_COMMON, "more", "begins", "c"),
    "stiff": (*_COMMON, "bend"),
    "thick stiff": (*_COMMON, "bend", "c"),
}
BOX = {
    "i": (0.001, 3.0),
    "j": (0.05, 0.8),
    "h": (0.5, 15.0),
    "w": (3.0, 40.0),
    "more": (2.0, 200.0),
    "begins": (0.15, 0.25),
    "bend": (2.0, 200.0),
    "c": (0.05, 6.0),
}
"""Inertia of table and drum; of the drum over it; angular momentum of the rotor, stiffness, further or cubed stiffness,
and resistance over the inertia of the drum; angle from which on there is a further spring."""
FAR = 0.2


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
    plain=(*_COMMON, "bend", "c"),
)
"""The plain law is a stiffening spring in oil."""
RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 2)],
    [
        Channel("get_position", "object_2", "angle"),
        Channel("get_velocity", "object_1", "angular_velocity"),
        Channel("get_velocity", "object_2", "angular_velocity"),
    ],
    decimals=6,
)


def _course(readings):
    """The course up to where the latch caught."""
    course = RIG.course(readings)
    return course.until(abs(course.readings[:, 0]) > LATCH - 0.003)


def _torque(knobs, tilt):
    """Torque of the springs that balances the rotor in steady turning."""
    return float(knobs["i"] * knobs["j"] * knobs["h"] * TURN * np.cos(tilt))


def predict(structure, knobs):
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


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.002, 0.008, 0.032, 0.128, 0.512, 2.0, 8.0),
    touch_s=0.15,
    moved=lambda reading: abs(reading[1]) > 0.03,
    strongest=lambda plan: min(
        TORQUE, 1.2 * plan.reach * plan.knobs["w"] / plan.knobs["h"] * plan.knobs["i"] / plan.span
    ),
    worth=lambda plan, path: to_a_side(plan, path[:, 0], FAR, abs(path[:, 0])),
    span=lambda knobs: float(np.clip(0.9 / np.sqrt(knobs["w"] + knobs["h"] ** 2 * knobs["j"]), 0.08, 0.5)),
    reaches=(0.08, 0.14, 0.2, 0.25, 0.28, 0.3, 0.315, 0.325),
    wider=lambda course: 0.04 + 2 * float(abs(course.readings[:, 0]).max()),
    legs=2,
    time_s=11.2,
    fixed_pushes=(0.003, -0.006, 0.012, -0.024, 0.05, -0.1, 0.2, -0.4, 0.8, -1.6, 4.0, -8.0),
    fixed_s=0.35,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Both springs, with and without oil, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """The springs of small tilts; these, and the tilt in proportion to the turning."""
    small = predict("stiff", {**knobs, "bend": 0.0})
    ratio = knobs["h"] * TURN / knobs["w"]
    return {"springs of small tilts": small, "in proportion": [ratio, _torque(knobs, 0.0), 2 * ratio]}


def stage(task):
    """Turn as hard as possible, and read the tilt."""
    calls = [*RIG.leg(TORQUE, 0.6, 2), *RIG.leg(0.0, 0.6, 2)]
    readings = yield calls
    tilt = max(abs(reading["angle"]) for reading in readings if reading.get("angle") is not None)
    yield [answer([tilt, TORQUE, tilt])]


def _turned(engine, tilt):
    """The engine without latch, with a table that nothing slows, at the asked spin."""
    heavy = {"body[latch].pos": (0.0, 0.0, 0.0), "body[object_1]/inertial.diaginertia": (1e7, 1e7, 1e7)}
    return engine.changed({**heavy, "key[start].qpos": (0.0, tilt), "key[start].qvel": (TURN, 0.0)})


def measure(engine, knobs):
    """The tilt at which the drum of a turning table does not speed up; the course after the blow."""
    low, high = 0.0, np.pi / 2
    for _ in range(22):
        tilt = (low + high) / 2
        free = _turned(engine, tilt)
        free.step(1)
        low, high = (tilt, high) if free.turn("object_2").spin > 0 else (low, tilt)
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qvel": (BLOW, 0.0)})
    path = [0.0]
    while len(path) < 3 or path[-1] >= path[-2]:
        free.step(1)
        path.append(float(free.turn("object_2").angle))
    return [tilt, _torque(knobs, tilt), path[-2]]


def settles(engine, knobs, off):
    """Where the drum ends on the turning table, with some oil in its bearings to calm it."""
    tilt = predict(knobs["kind"], knobs)[0]
    oiled = engine.changed({"joint[tilting].damping": knobs["drum"] * knobs["own"]})
    free = _turned(oiled, tilt * (1 + off))
    free.step(free.whole_steps(10.0))
    return float(free.turn("object_2").angle) / tilt - 1
