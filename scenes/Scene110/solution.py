"""Scene 110: brake the wheel by heavier and heavier loads down to just above the fuse; the laws give the far torque."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, hung, torque_at_spin
from scenes.protocol import answer
from scenes.springs import best_edge, solved
from scenes.wheels import LoadedPan, left_spin

BRAKE, ASKED, FUSE = 0.01, 4.0, 12.0
KINDS = ("even", "square", "power")
PAN = LoadedPan("object_2", 1.0, wait_s=8.0)
FIRST_S, FIRST_KG = 14.0, 0.002
SIGMA = 1.5e-3
"""Standard deviation of a spin that is read, rad/s."""
IDLE_SIGMA = 0.7 * SIGMA
"""That of the idle spin."""
GOALS = (20.0, 18.5, 17.0, 15.7, 14.7, 14.0, 13.5, 13.1, 12.8, 12.55, 12.35, 12.2)
"""Spins that are aimed at, rad/s."""
TURNS = 15
EDGES, IDLES = (12.7, 14.5), (20.0, 25.5)
"""Between which the second torque begins, and between which the idle spin is, rad/s."""


def _parts(kind, spin, edge, idle):
    """Torques of the motor of unit strength."""
    first = {"even": idle - spin, "square": idle**2 - spin**2, "power": 1 / spin - 1 / idle}[kind]
    return [first, np.maximum(edge - spin, 0.0)]


def _points(rows):
    """Spins, torques and their errors at all loads; the idle spin."""
    spin, load = rows.T
    braked = load > 1e-9
    idle = float(spin[~braked].mean()) if (~braked).any() else 23.0
    spin, torque = spin[braked], BRAKE * (load * spin)[braked]
    slope = np.abs(np.gradient(torque, spin)) if len(spin) > 2 else torque / np.maximum(idle - spin, 0.1)
    return spin, torque, 1.5 * SIGMA * (slope + torque / np.maximum(idle - spin, 0.1)) + 3e-4 * torque, idle


def _fitted(rows, kind):
    """Misfit; strengths, edge and idle spin of one kind."""
    spin, torque, error, idle = _points(rows)

    def at(edge, idle):
        return solved(_parts(kind, spin, edge, idle), torque, error)

    def off(p):
        return np.append(at(*p)[0], (p[1] - idle) / IDLE_SIGMA)

    edge = best_edge(lambda edge: at(edge, idle), np.linspace(12.6, 14.6, 26), (12.4, 14.8))
    best = least_squares(off, [edge, idle], bounds=([12.4, 19.0], [14.8, 26.0]), diff_step=1e-5, x_scale=[0.1, 0.01])
    found = at(*best.x)[1]
    return 2 * best.cost + 1e3 * float((found < 0).sum()), (*found, *best.x)


def _far(kind, constants):
    """Torque at the asked spin."""
    first, second, edge, idle = constants
    return float(np.dot([first, second], _parts(kind, ASKED, edge, idle)))


def _rows(exchanges):
    """Rows of spin and load, until the fuse has blown."""
    rows = []
    for asked, reading, load in hung(exchanges):
        if asked.tool == "get_velocity":
            if (spin := reading["angular_velocity"]) < FUSE:
                break
            rows.append((spin, GRAVITY * load[PAN.body]))
    return np.array(rows)


def _best(rows):
    """The torque by the kind that fits best."""
    fits = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(fits, key=lambda name: fits[name][0])
    return _far(kind, fits[kind][1])


def fit(readings, structure):
    """The far torque with one law of the motor."""
    return _far(structure, _fitted(_rows(readings), structure)[1])


def _weighed(rows, kind):
    """The law of one kind, fitted with strengths that are not negative."""
    spin, torque, error, idle = _points(rows)
    units = [float(torque.max() / part.max()) for part in _parts(kind, spin, EDGES[1], idle)]

    def misfits(constants):
        first, second, edge, idle_spin = constants
        parts = _parts(kind, spin, edge, idle_spin)
        left = first * units[0] * parts[0] + second * units[1] * parts[1] - torque
        return np.append(left / error, (idle_spin - idle) / IDLE_SIGMA)

    first, second, edge, idle_spin = _fitted(rows, kind)[1]
    ranges = [(0.0, 3.0), (0.0, 3.0), EDGES, IDLES]
    low, high = np.array(ranges).T
    start = np.clip([first / units[0], second / units[1], edge, idle_spin], low + 1e-3, high - 1e-3)
    best = least_squares(misfits, start, bounds=(low, high), x_scale=[1.0, 1.0, 0.1, 0.01]).x
    return member(misfits, lambda found: _far(kind, np.array([*units, 1.0, 1.0]) * found), best, ranges)


def rivals(readings):
    """Each law of the motor, fitted."""
    rows = _rows(readings)
    return {kind: _weighed(rows, kind) for kind in KINDS}


def solve(task):
    """Read the idle spin; then each load follows from the torques at the spins before."""
    calls, exchanges, kg = [*PAN.look(FIRST_S), *PAN.load(0, FIRST_KG)], [], FIRST_KG
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
        calls = PAN.load(number, kg)
    yield [answer(_best(_rows(exchanges)))]


def batch(task):
    """The idle spin, loads in even ratios, and the best fit."""
    calls = PAN.look(FIRST_S)
    for rung in range(11):
        calls += PAN.load(rung, 0.02 * 1.6**rung)
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 3 else 1.0)]


def stage(task):
    """Brake at once with much."""
    readings = yield [*PAN.look(), *PAN.load(0, 20.0)]
    yield [answer(BRAKE * GRAVITY * 20.0 * max(readings[-1]["angular_velocity"], 1e-3))]


def _torque(knobs, spin, second=1.0):
    """Torque of the motor."""
    idle = knobs["idle"]
    first = {"even": 2 / idle, "square": 1 / 0.75 / idle**2, "power": idle}[knobs["kind"]]
    parts = _parts(knobs["kind"], spin, knobs["begins"], idle)
    return knobs["scale"] * float(np.dot([first, second * knobs["more"]], parts))


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


def _without_fuse(engine):
    """The engine without the fuse, after the starter has let go."""
    free = engine.changed({"body[trigger]/inertial.mass": 1e12})
    free.step(free.whole_steps(5.0))
    return free


def measure(engine, knobs):
    """Torque that keeps the engine's wheel at the asked spin."""
    scale = knobs["scale"]
    return -torque_at_spin(_without_fuse(engine), PAN.wheel, ASKED, scale, 0.01 * scale)


def settles(engine, knobs, off):
    """The spin of the wheel, brought to a spin near the asked one, under the asked torque."""
    torques = [-_torque(knobs, ASKED * (1 + part)) for part in (off, 0.0)]
    return left_spin(_without_fuse(engine), PAN.wheel, PAN.wheel, torques, ASKED, 15.0)
