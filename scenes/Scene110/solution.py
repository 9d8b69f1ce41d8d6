"""Scene 110: brake the wheel by heavier and heavier loads down to just above the fuse; the laws give the far torque."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, BRAKE, ASKED = 9.81, 0.01, 4.0
FUSE, STARTED = 12.0, 19.8
KINDS = ("even", "square", "power")
DENSITY, HEIGHT = 1e5, 1.0
WAIT_S, FIRST_S = 8.0, 14.0
FIRST_KG = 0.002
SIGMA = 1.5e-3
"""Standard deviation of a spin that is read, rad/s."""
GOALS = (20.0, 18.5, 17.0, 15.7, 14.7, 14.0, 13.5, 13.1, 12.8, 12.55, 12.35, 12.2)
"""Spins that are aimed at, rad/s."""
TURNS = 15
EDGES = np.linspace(12.6, 14.6, 26)


def _shape(kind, spin, idle):
    """Torque of the motor over its strength."""
    return {"even": idle - spin, "square": idle**2 - spin**2, "power": 1 / spin - 1 / idle}[kind]


def _fitted(rows, kind):
    """Misfit, and torque at the asked spin, with one kind."""
    spin, load = rows.T
    torque = BRAKE * load * spin
    idle = float(spin[load == 0].mean()) if (load == 0).any() else 23.0
    braked = load > 0
    spin, torque = spin[braked], torque[braked]
    slope = np.abs(np.gradient(torque, spin)) if len(spin) > 2 else torque / np.maximum(idle - spin, 0.1)
    size = 1.5 * SIGMA * (slope + torque / np.maximum(idle - spin, 0.1)) + 3e-4 * torque

    def solved(edge, idle):
        columns = [_shape(kind, spin, idle), np.maximum(edge - spin, 0.0)]
        table = np.column_stack(columns) / size[:, None]
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, torque / size, rcond=None)[0] / scale
        return np.append(table @ found - torque / size, 0.0), found

    def off(p):
        misfit = solved(*p)[0]
        misfit[-1] = (p[1] - idle) / (0.7 * SIGMA)
        return misfit

    edge = min(EDGES, key=lambda edge: float((solved(edge, idle)[0] ** 2).sum()))
    best = least_squares(off, [edge, idle], bounds=([12.4, 19.0], [14.8, 26.0]), diff_step=1e-5, x_scale=[0.1, 0.01])
    found = solved(*best.x)[1]
    far = found @ np.array([_shape(kind, ASKED, best.x[1]), max(best.x[0] - ASKED, 0.0)])
    return 2 * best.cost + 1e3 * float((found < 0).sum()), float(far)


def _rows(exchanges):
    """Rows of spin and load, until the fuse has blown."""
    rows, made, load = [], {}, 0.0
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            load += made[asked.arguments["object1_id"]]
        elif asked.tool == "delete_objects":
            load -= made[asked.arguments["object_id"]]
        elif asked.tool == "get_velocity":
            if (spin := reading["angular_velocity"]) < FUSE:
                break
            rows.append((spin, GRAVITY * load if load > 1e-9 else 0.0))
    return np.array(rows)


def _best(rows):
    """The torque by the kind that fits best."""
    return min(_fitted(rows, kind) for kind in KINDS)[1]


def fit(readings, structure):
    """The far torque with one law of the motor."""
    return _fitted(_rows(readings), structure)[1]


def _look(lasting=WAIT_S):
    return [call("step", duration=lasting), call("get_velocity", object_id="object_1")]


def _load(number, kg):
    """Load the pan with a ball instead of the one before, wait, and read the spin."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [1.0 + 0.15 * (number % 2), 0.0, HEIGHT]
    made = call("create_objects", name=f"b{number}", pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    return [made, call("attach_objects", object1_id=f"b{number}", object2_id="object_2"), *old, *_look()]


def solve(task):
    """Read the idle spin; then each load follows from the torques at the spins before."""
    calls, exchanges, kg = [*_look(FIRST_S), *_load(0, FIRST_KG)], [], FIRST_KG
    for number in range(1, TURNS + 1):
        exchanges += zip(calls, (yield calls), strict=True)
        rows = _rows(exchanges)
        spin, torque = rows[-1, 0], BRAKE * rows[-1, 0] * rows[-1, 1]
        goal = next((goal for goal in GOALS if goal < spin - (0.3 if spin > 14.1 else 0.1)), None)
        if goal is None:
            break
        before, less = rows[-2, 0], BRAKE * rows[-2, 0] * rows[-2, 1]
        slope = max(torque - less, 1e-7) / max(before - spin, 2e-3)
        # The torque may grow more slowly from here on than before.
        wanted = torque + 0.93 * slope * (spin - goal)
        kg = min(wanted / BRAKE / goal / GRAVITY, 150 * kg)
        calls = _load(number, kg)
    yield [answer(float(_best(_rows(exchanges))))]


def batch(task):
    """The idle spin, loads in even ratios, and the best fit."""
    calls = _look(FIRST_S)
    for rung in range(11):
        calls += _load(rung, 0.02 * 1.6**rung)
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(float(_best(rows)) if len(rows) > 3 else 1.0)]


def stage(task):
    """Brake at once with much."""
    readings = yield [*_look(), *_load(0, 20.0)]
    yield [answer(BRAKE * GRAVITY * 20.0 * max(readings[-1]["angular_velocity"], 1e-3))]


def structure(knobs):
    """Law of the motor."""
    return knobs["kind"]


def _torque(knobs, spin, second=1.0):
    idle = knobs["idle"]
    first = {"even": 2 / idle, "square": 1 / 0.75 / idle**2, "power": idle}[knobs["kind"]]
    more = second * knobs["more"] * max(knobs["begins"] - spin, 0.0)
    return knobs["scale"] * (first * _shape(knobs["kind"], spin, idle) + more)


def naive(knobs):
    """The first torque alone; and the slope near the idle spin."""
    idle = knobs["idle"]
    return {
        "no second torque": _torque(knobs, ASKED, 0.0),
        "slope near the idle spin": _torque(knobs, idle - 2) / 2 * (idle - ASKED),
    }


def theory(knobs):
    """The torque of the motor at the asked spin."""
    return _torque(knobs, ASKED)


def measure(engine, knobs):
    """Torque that keeps the engine's wheel at the asked spin, without the fuse."""
    free = engine.changed({"body[trigger]/inertial.mass": 1e12})
    torque, scale = 0.0, knobs["scale"]
    free.step(free.whole_steps(5.0))
    for _ in range(free.whole_steps(40.0)):
        spin = float(free.turn("object_1").spin)
        torque += 0.01 * scale * (ASKED - spin)
        held = torque + scale * (ASKED - spin)
        free.push("object_1", torque=np.array([0.0, 0.0, held]))
        free.step(1)
    return -torque
