"""Scene 47: two meetings, the second faster, give the potential at many distances, and its form the rest."""

from math import sqrt

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

PUCK, MASS = "object_1", 1.0
START_M = 3.0
ASKED_M_S = 3.2
LIMIT_N = 0.25
LOOKS = 4
NEARER = (0.3, 0.09)
"""Share of the distance that is covered between two looks on the way in, in each meeting."""
SLOWEST_M_S = (0.3, 1.0)
"""Speed from which on slower motion is not looked at more seldom, in each meeting."""
SHORTEST_S, LONGEST_S = 0.005, 1.0
COAST_S = 5.2


def _power(ratio, shape):
    return ratio**-shape


def _decay(ratio, shape):
    return np.exp(np.minimum((1 - ratio) / shape, 60))


def _range(ratio, shape):
    return (np.maximum(1 + shape - ratio, 0) / shape) ** 2


CORES = {"power": (_power, (2.5, 4.0)), "decay": (_decay, (0.15, 0.25)), "range": (_range, (0.13, 0.22))}
"""Structure → core of the potential over the distance in units of a size, and starts of its shape."""


def _law(core, d, p):
    """Potential over the reduced mass.

    p is log level, log size, shape, strength of a far force of either sign, start and log strength of an inner push.
    """
    ratio = d / np.exp(p[1])
    inner = np.exp(p[5]) * np.maximum(1 - ratio / p[4], 0) ** 2
    return np.exp(p[0]) * ((1 + p[3]) * core(ratio, p[2]) - p[3] * np.exp((1 - ratio) / 4)) + inner


def _rows(exchanges):
    """Time, place 1, velocity 1, place 2, push since the reading before; and velocity 2 where it was read."""
    push, rows, other, now = 0.0, [], None, {}
    for asked, reading in exchanges:
        who = asked.arguments.get("object_id")
        if asked.tool == "apply_force":
            push = asked.arguments["force_vector"][0]
        elif asked.tool == "get_position":
            now["own" if who == PUCK else "its"] = reading["position"][0]
        elif asked.tool == "get_velocity" and who == PUCK:
            now["speed"], now["time"] = reading["velocity"][0], reading["sim_time"]
        elif asked.tool == "get_velocity":
            other = reading["velocity"][0]
            rows.append([now["time"], now["own"], now["speed"], now["its"], push, other])
    return np.array(rows)


def _potential(rows):
    """Distances and the potential over the reduced mass there, counted from the start, and the mass of puck 2."""
    times, own, speed, its, push, other = np.vstack([[0, -START_M, 0, 0, 0, 0], rows]).T
    impulse = np.cumsum(push[1:] * np.diff(times))
    work = np.cumsum(push[1:] * np.diff(own))
    mass = float(np.dot(impulse - MASS * speed[1:], other[1:]) / np.dot(other[1:], other[1:]))
    energy = work - MASS * speed[1:] ** 2 / 2 - mass * other[1:] ** 2 / 2
    return its[1:] - own[1:], energy * (1 / MASS + 1 / mass), mass


def _fitted(distance, potential, name):
    """Score, low for small misfits, core and parameters of the best potential of a structure."""
    core, shapes = CORES[name]
    near, level = float(distance.min()), max(float(potential.max()), 0.03)

    def misfit(p):
        slope = (_law(core, distance + 1e-4, p) - _law(core, distance - 1e-4, p)) / 2e-4
        return (_law(core, distance, p) - _law(core, START_M, p) - potential) / np.hypot(0.002, 3e-4 * slope)

    fits = []
    for shape in shapes:
        for weak in (-0.3, 0.5):
            for size in (1.2 * near, 1.6 * near):
                begin = [np.log(level / 3), np.log(size), shape, weak, 1.05 * near / size, np.log(50.0)]
                low = [-8, np.log(near) - 3, shapes[0] / 3, -0.9, 0.2, np.log(10.0)]
                high = [3, np.log(near) + 3, 3 * shapes[1], 3, 2.0, np.log(300.0)]
                found = least_squares(misfit, begin, bounds=(low, high), max_nfev=60, x_scale=0.1)
                fits.append((found.cost, core, found.x))
    return min(fits, key=lambda fit: fit[0])


def _closest(core, p):
    """Where the potential over the reduced mass equals half the square of the speed."""
    wanted, low = ASKED_M_S**2 / 2, 1e-3
    if _law(core, low, p) < wanted:
        return low
    return float(brentq(lambda d: _law(core, d, p) - wanted, low, START_M))


def fit(readings, structure):
    """The distance by the potential of a structure."""
    distance, potential, _ = _potential(_rows(readings))
    return _closest(*_fitted(distance, potential, structure)[1:])


def _best(exchanges):
    distance, potential, _ = _potential(_rows(exchanges))
    return _closest(*min((_fitted(distance, potential, name) for name in CORES), key=lambda fit: fit[0])[1:])


def _push(force):
    return call("apply_force", object_id=PUCK, force_vector=[force, 0.0, 0.0])


def _look(seconds, other):
    seconds = max(0.005 * round(seconds / 0.005), SHORTEST_S)
    return [
        call("step", duration=seconds),
        call("get_position", object_id=PUCK),
        call("get_position", object_id=other),
        call("get_velocity", object_id=PUCK),
        call("get_velocity", object_id=other),
    ]


def _when(distance, speed, pull, target):
    """Time until the distance is `target`, approaching with a speed and a steady push over the mass."""
    if speed < 0:
        away = -speed / pull
        return away + _when(distance + speed**2 / 2 / pull, 0.0, pull, target)
    return (sqrt(speed**2 + 2 * pull * max(distance - target, 0.0)) - speed) / pull


def solve(task):
    """Meet twice, the second time from farther off; look more often the nearer the pucks are."""
    readings = yield [call("find_objects")]
    other = readings[0]["revealed"][0]["object_id"]
    exchanges = []

    def state(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        own, its, speed, its_speed = readings[-4:]
        return its["position"][0] - own["position"][0], speed["velocity"][0] - its_speed["velocity"][0]

    calls = [_push(LIMIT_N), *_look(_when(START_M, 0.0, LIMIT_N, 1.5), other)]
    distance, speed = state(calls, (yield calls))
    nearest = distance
    for meeting in range(2):
        if meeting:
            calls = [_push(0.0), *_look(COAST_S, other), _push(LIMIT_N)]
            readings = yield calls
            exchanges.extend(zip(calls, readings, strict=True))
            own, its, velocity, its_velocity = readings[-5:-1]
            distance = its["position"][0] - own["position"][0]
            speed = velocity["velocity"][0] - its_velocity["velocity"][0]
            calls = _look(_when(distance, speed, LIMIT_N, min(1.6 * nearest, 1.5)), other)
            distance, speed = state(calls, (yield calls))
        while True:
            pause = min(NEARER[meeting] * distance / max(abs(speed), SLOWEST_M_S[meeting]), LONGEST_S)
            calls = _look(pause, other) * (2 if distance > 0.5 else 3)
            before = speed
            distance, speed = state(calls, (yield calls))
            nearest = min(nearest, distance)
            if (before < 0 and speed < 0) or len(exchanges) > (56 if meeting == 0 else 135):
                break
    yield [answer(_best(exchanges))]


def structure(knobs):
    """The form of the potential."""
    return knobs["kind"]


def theory(knobs):
    """Where the drawn potential equals the energy in the frame of the centre of mass."""
    return _drawn_closest(knobs, ASKED_M_S**2 / 2)


def _drawn_closest(knobs, energy, *, inner=True):
    kind = knobs["kind"]
    shape = {"power": knobs["n"], "decay": knobs["share"], "range": knobs["reach"] - 1}[kind]
    p = [
        np.log(knobs["level"]),
        np.log(knobs["size"]),
        shape,
        knobs["weak"],
        knobs["inner"] / knobs["size"],
        np.log(knobs["hard"] if inner else 1e-9),
    ]
    return float(brentq(lambda d: _law(CORES[kind][0], d, p) - energy, 1e-4, START_M))


def measure(engine, knobs):
    """The meeting in the engine, from so far away that the potential does not count."""
    far = 60.0
    engine.place(PUCK, np.array([-far, 0.0, 0.0]), {})
    engine.set_velocity(PUCK, np.array([ASKED_M_S, 0.0, 0.0]))
    nearest = far
    for _ in range(engine.whole_steps(far / ASKED_M_S + 4.0)):
        engine.step(1)
        nearest = min(nearest, float(engine.pose("object_2").position[0] - engine.pose(PUCK).position[0]))
    return nearest


def naive(knobs):
    """The closest distance of a slow meeting, less in proportion to the speed; puck 2 taken for fixed."""
    slow = _drawn_closest(knobs, 0.7)
    hooke = slow * sqrt(0.7 / (ASKED_M_S**2 / 2))
    outer = _drawn_closest(knobs, ASKED_M_S**2 / 2, inner=False)
    return {"in proportion to the speed": hooke, "the law of a slow meeting": outer}


def stage(task):
    """Push for as long as the laboratory allows, and answer with the nearest place seen."""
    readings = yield [call("find_objects")]
    other = readings[0]["revealed"][0]["object_id"]
    calls = [_push(LIMIT_N), *(_look(0.9, other) * 26)]
    readings = yield calls
    places = [reading["position"][0] for reading in readings if "position" in reading]
    yield [answer(float(min(its - own for own, its in zip(places[::2], places[1::2], strict=True))))]


def batch(task):
    """A run-up, a steady push, and looks at even intervals around the time when they must meet."""
    calls = [call("find_objects"), _push(-LIMIT_N), *_look(4.0, "object_2"), _push(LIMIT_N)]
    calls += [*_look(10.75, "object_2"), *(_look(0.08, "object_2") * 9)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]
