"""Scene 108: spins of the wheel under growing loads, without and with press; both laws, and the torque far beyond."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, ARM, LEVER = 9.81, 0.1, 10.0
ASKED_SPIN, ASKED_N = 20.0, 600.0
BRAKE, SLOWEST = 10.0, 0.6
KINDS = ("dry", "thick", "root")
DENSITY, HEIGHT = 1e5, 1.0
PANS = {"object_2": 1.0, "object_3": -1.0}
"""Pan of the motor and pan of the bearing, and where they stand along x, m."""
WAIT_S = 9.0
FIRST_KG = 0.008
TURNS = 8
SIGMA = 1.5e-3
"""Standard deviation of a spin that is read, rad/s."""
GOALS = (2.5, 4.5, 6.5, 7.6, 8.6, 9.4)
"""Spins that are aimed at, rad/s."""
SAFE = 9.3
PRESS_N, LESS_N = 45.0, 15.0
EDGES = np.linspace(5.5, 8.0, 26)


def _columns(kind, spin, press, edge):
    """What the torque is linear in."""
    with_press = {
        "dry": press * np.tanh(spin / 0.15),
        "thick": press * spin,
        "root": np.sqrt(press) * spin / np.sqrt(spin + 0.01),
    }
    return [spin, np.maximum(spin - edge, 0.0), with_press[kind]]


def _fitted(rows, kind):
    """Misfit, and torque at the asked spin and press, with one kind."""
    spin, torque, press = rows.T
    size = torque / spin * 2 * SIGMA + 1e-3 * torque

    def solved(edge):
        table = np.column_stack(_columns(kind, spin, press, edge)) / size[:, None]
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, torque / size, rcond=None)[0] / scale
        return table @ found - torque / size, found

    edge = min(EDGES, key=lambda edge: float((solved(edge)[0] ** 2).sum()))
    edge = float(least_squares(lambda at: solved(at[0])[0], [edge], bounds=(5.3, 8.2), diff_step=1e-4).x[0])
    misfit, found = solved(edge)
    far = np.array(_columns(kind, np.float64(ASKED_SPIN), np.float64(ASKED_N), edge))
    return float((misfit**2).sum()) + 1e3 * float((found < 0).sum()), float(far @ found)


def _rows(exchanges):
    """Rows of spin, torque of the motor, and force that presses the bearing."""
    rows, made, load = [], {}, dict.fromkeys(PANS, 0.0)
    joined = {}
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            ball, pan = asked.arguments["object1_id"], asked.arguments["object2_id"]
            load[pan] += made[ball]
            joined[ball] = pan
        elif asked.tool == "delete_objects":
            ball = asked.arguments["object_id"]
            load[joined[ball]] -= made[ball]
        elif asked.tool == "get_velocity" and SLOWEST < (spin := reading["angular_velocity"]) < BRAKE:
            rows.append((spin, ARM * GRAVITY * load["object_2"], LEVER * GRAVITY * load["object_3"]))
    return np.array(rows)


def _best(rows):
    """The torque by the kind that fits best."""
    return min(_fitted(rows, kind) for kind in KINDS)[1]


def fit(readings, structure):
    """The far torque with one kind of what comes with the press."""
    return _fitted(_rows(readings), structure)[1]


def _ball(pan, name, kg, old=None):
    """A ball joined to a pan, instead of an old one."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [PANS[pan] + 0.1 * (int(name[1:]) % 2), 0.0, HEIGHT]
    made = call("create_objects", name=name, pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    gone = [call("delete_objects", object_id=old)] if old else []
    return [made, call("attach_objects", object1_id=name, object2_id=pan), *gone]


def _load(number, kg):
    """Load the motor's pan with a ball instead of the one before, wait, and read the spin."""
    ball = _ball("object_2", f"b{number}", kg, f"b{number - 1}" if number else None)
    return [*ball, call("step", duration=WAIT_S), call("get_velocity", object_id="object_1")]


def _press(number, newtons):
    """Press the bearing with a ball instead of the one before."""
    return _ball("object_3", f"p{number}", newtons / LEVER / GRAVITY, f"p{number - 1}" if number else None)


def solve(task):
    """Turn the free wheel up to just below the brake; then press it, and never load more than is surely safe."""
    exchanges, number, kg, calls = [], 0, FIRST_KG, []
    spins, loads = [0.0], [0.0]
    for _ in range(TURNS):
        calls = _load(number, kg)
        number += 1
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        spins.append(readings[-1]["angular_velocity"])
        loads.append(kg)
        if spins[-1] > GOALS[-1] - 0.3:
            break
        slope = (kg - loads[-2]) / max(spins[-1] - spins[-2], 1e-2)
        goal = next(goal for goal in GOALS if goal > spins[-1] + 0.4)
        kg = min(max(kg + slope * (goal - spins[-1]), 1.05 * kg), 80 * kg)
    top = float(np.interp(SAFE, spins, loads))
    calls, kg = _press(0, PRESS_N), 0.97 * top
    for _ in range(4):
        calls += _load(number, kg)
        number += 1
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        spin, calls, held = readings[-1]["angular_velocity"], [], kg
        # What the press adds does not shrink with the spin.
        kg = 0.98 * top + 0.97 * max(kg - float(np.interp(spin, spins, loads)), 0.0)
        if kg < 1.06 * held:
            break
    for part in (0.8, 0.62, 0.47):
        calls += _load(number, part * held)
        number += 1
    calls += _press(1, LESS_N)
    for part in (0.6, 0.4):
        calls += _load(number, part * held)
        number += 1
    exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(float(_best(_rows(exchanges))))]


def batch(task):
    """Loads in even ratios on the pressed wheel, and the best fit."""
    calls = _press(0, PRESS_N)
    for rung in range(11):
        calls += _load(rung, 0.06 * 1.6**rung)
    readings = yield calls
    rows = _rows(list(zip(calls, readings, strict=True)))
    yield [answer(float(_best(rows)) if len(rows) > 3 else 10.0)]


def stage(task):
    """Load the motor at once with much."""
    readings = yield [*_load(0, 20.0), *_press(0, 49.0), call("step", duration=5.0)]
    yield [answer(ARM * GRAVITY * 20.0 * ASKED_SPIN / max(readings[3]["angular_velocity"], 0.5))]


def structure(knobs):
    """What comes with the press."""
    return knobs["kind"]


def _torque(knobs, spin, press):
    kind, scale = knobs["kind"], knobs["scale"]
    with_press = {"dry": press / 45 * 5, "thick": press / 45 * spin, "root": (press * 5 * spin / 45) ** 0.5}
    return scale * (spin + knobs["more"] * max(spin - knobs["edge"], 0.0) + knobs["press"] * with_press[kind])


def naive(knobs):
    """The torque at 5 rad/s and 45 N, carried over in proportion to the spin, and what the press adds also to it."""
    free, pressed = _torque(knobs, 5.0, 0.0), _torque(knobs, 5.0, 45.0)
    more = pressed - free
    return {
        "in proportion": free * ASKED_SPIN / 5 + more * ASKED_N / 45 * ASKED_SPIN / 5,
        "without the change": _torque({**knobs, "more": 0.0}, ASKED_SPIN, ASKED_N),
    }


def theory(knobs):
    """The resistance at the asked spin and press."""
    return _torque(knobs, ASKED_SPIN, ASKED_N)


def measure(engine, knobs):
    """Torque at which the engine's wheel, pressed by a force on the pan, keeps the asked spin."""
    free = engine.changed({"body[trigger]/inertial.mass": 1e12})
    free.push("object_3", force=np.array([0.0, 0.0, -ASKED_N / LEVER]))
    torque, scale = 0.0, knobs["scale"]
    for _ in range(free.whole_steps(40.0)):
        spin = float(free.turn("object_1").spin)
        torque += 0.1 * scale * (ASKED_SPIN - spin)
        held = torque + 4 * scale * (ASKED_SPIN - spin)
        free.push("object_1", torque=np.array([0.0, 0.0, held]))
        free.step(1)
    return torque
