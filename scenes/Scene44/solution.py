"""Scene 44: the profile of the gas from one descent, the power and the lift from three loads at one depth."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, ball, hung, joined
from scenes.protocol import answer, call
from scenes.rigs import motion

FLOAT = "object_1"
FLOAT_KG, FAR_KG = 3.0, 75.0
TOP, ASKED, BOTTOM, TRAP = 4.25, 3.75, 3.72, 3.85
"""Height of the start; depths: that is asked for, beyond which it may get into the trap, and of the trap, m."""
READ_M, READ_M_S = 4e-4, 2e-4
"""Standard deviations of a difference of depths that are read, and of a speed."""
PARTS = 96
"""Parts of a leg in the fit."""
MOST_STEPS = 20000
"""Most steps of the descent that is asked for."""
HEAVY_KG, MIDDLE_KG, SMALL_KG = 6.0, 2.25, 0.75
SPACING, NEAR, NEAR_SPACING = 0.212, 3.0, 0.11
"""Way between two readings of a descent, m."""
DESCENT_S = 67.0
LONGEST_S = 21.0
EDGE = 0.0875
ABOUT_N = 12.0
"""A lift to begin with, N."""
POWERS, KINDS = (1.0, 1.5, 2.0), ("two layers", "three layers")
CONSTANTS = {"two layers": (0, 1, 3, 5), "three layers": (0, 1, 2, 3, 4, 5)}
"""Which are fitted: lift, logarithm of the factor, changes of the resistance, and depths of the boundaries."""
LOW, HIGH = np.array([3, -8, -0.95, -9, 0, 0.25]), np.array([21, 9, 9, 9, 3.5, 3.6])
"""Bounds of these six."""
RADIUS = 0.05
PLACES = {"heavy": 1, "middle": 2, "small": 3, "load": 4}
"""Where balls are made, beside the shaft, m."""


def _beyond(depth, edge):
    """How much of a boundary is passed at a depth, from 0 to 1."""
    return 0.5 + 0.5 * np.tanh((depth - edge) / EDGE)


def _gas(depth, first, second, edge, last):
    """Resistance over that at the top."""
    return 1 + first * _beyond(depth, edge) + second * _beyond(depth, last)


def _speed(power, lift, factor, *profile):
    """Speed under the far load at the asked depth: the equation of motion by the Runge-Kutta method."""
    force, mass, step = FAR_KG * GRAVITY - lift, FLOAT_KG + FAR_KG, 0.0007
    grid = 0.00125
    gases = (factor * _gas(np.arange(0, ASKED + 1, grid), *profile)).tolist()

    def pull(depth, speed):
        cell, share = divmod(depth / grid, 1)
        gas = gases[int(cell)] * (1 - share) + gases[int(cell) + 1] * share
        return (force - gas * abs(speed) ** power) / mass

    depth = speed = 0.0
    for _ in range(MOST_STEPS):
        a = pull(depth, speed)
        b = pull(depth + step / 2 * speed, speed + step / 2 * a)
        way = step * (speed + step / 2 * a)
        if depth + way >= ASKED:
            return speed + b * step * (ASKED - depth) / way
        depth, speed = depth + way, speed + step * b
    return speed  # of a gas in which it hardly sinks


def _start(legs, kind, power):
    """Profile to start from: the edges between which the resistance is most nearly constant, at the lift `ABOUT_N`."""
    load, duration, first, before, last, after = legs.T
    depth, speed, rate = (first + last) / 2, (last - first) / duration, (after - before) / duration
    force = load * GRAVITY - ABOUT_N - (FLOAT_KG + load) * rate
    own = (load > 4) & (speed > 0.005) & (force > 8)
    known, depth = np.log(force[own] / speed[own] ** power), depth[own]
    edges = np.arange(0.5, 3.75, 0.0625)
    pairs = [(edges[0] - 1.1, edge) for edge in edges]
    if kind == "three layers":
        pairs = [(edge, last) for edge in edges for last in edges if last - edge >= 0.43]
    best = None
    for edge, last in pairs:
        columns = np.column_stack([np.ones(len(depth)), _beyond(depth, edge), _beyond(depth, last)])
        levels = np.clip(np.linalg.lstsq(columns, known, rcond=1e-6)[0], -20, 20)
        left = float(np.sum((known - columns @ levels) ** 2))
        if best is None or left < best[0]:
            best = (left, levels, edge, last)
    _, levels, edge, last = best
    if kind == "two layers":
        return levels[0] + levels[1], 0.0, np.exp(levels[2]) - 1, edge, last
    middle = np.exp(levels[1])
    return levels[0], middle - 1, middle * (np.exp(levels[2]) - 1), edge, last


def _misfits(legs, kind, power):
    """Misfits of depths and speeds after each leg, as a function of the constants of this kind of gas."""
    load, duration, depth, speed, last_depth, last_speed = legs.T
    weight, mass, step = load * GRAVITY, FLOAT_KG + load, duration / PARTS
    # Of both readings; a depth that is read wrongly is in another gas.
    depth_error = np.hypot(READ_M, 0.001 * (last_depth - depth))
    speed_error = np.hypot(READ_M_S, 0.002 * last_speed)

    def misfits(constants):
        values = np.zeros(6)
        values[list(CONSTANTS[kind])] = constants
        drag = np.exp(values[1])

        def later(x, v, time):
            """The speed after a time in the gas of one depth, as if the resistance grew evenly with the speed."""
            slope = drag * np.maximum(_gas(x, *values[2:]), 0.05) * np.abs(v) ** (power - 1)
            rate = np.maximum(power * slope / mass, 1e-6)
            return v - np.expm1(-rate * time) / rate * (weight - values[0] - slope * v) / mass

        x, v = depth, speed
        for _ in range(PARTS):
            v = later(x, v, step / 2)
            x = x + v * step
            v = later(x, v, step / 2)
        return np.concatenate([(x - last_depth) / depth_error, (v - last_speed) / speed_error])

    return misfits


def _fitted(legs, kind, power):
    """The constants that fit best, and chi-square."""
    level, first, second, edge, last = _start(legs, kind, power)
    used = list(CONSTANTS[kind])
    begin = np.clip([ABOUT_N, level, first, second, max(edge, 0.12), last], LOW, HIGH)[used]
    scale = np.array([3, 0.3, 0.3, 0.3, 0.12, 0.12])[used]
    misfits = _misfits(legs, kind, power)
    tried = least_squares(misfits, begin, bounds=(LOW[used], HIGH[used]), x_scale=scale, max_nfev=200)
    return tried.x, 2 * tried.cost


def predict(structure, constants):
    """The speed in a gas with these constants."""
    kind, power = structure.split(", ")
    values = np.zeros(6)
    values[list(CONSTANTS[kind])] = constants
    return _speed(float(power), values[0], np.exp(values[1]), *values[2:])


def _best(legs):
    """The speed in the simplest gas that fits."""
    found = {(kind, power): _fitted(legs, kind, power) for kind in KINDS for power in POWERS}
    kind, power = min(found, key=lambda gas: found[gas][1] + 4 * len(CONSTANTS[gas[0]]))
    return predict(f"{kind}, {power:g}", found[kind, power][0])


def _legs(exchanges):
    """Rows of load [kg], duration [s], depth [m] and sinking speed [m/s] at its start and at its end."""
    legs, before, held, depth = [], None, 0.0, 0.0
    for asked, reading, load in hung(exchanges):
        if load[FLOAT] != held:
            held, before = load[FLOAT], None
        if asked.tool == "get_position":
            depth = TOP - reading["position"][2]
        elif asked.tool == "get_velocity":
            now = (reading["sim_time"], depth, -reading["velocity"][2])
            if before and min(depth, before[1]) > 0.005 and max(depth, before[1]) < TRAP:
                legs.append([held, now[0] - before[0], *before[1:], *now[1:]])
            before = now
    return np.array(legs)


def fit(readings, structure):
    """The asked speed by the law of one kind of gas."""
    kind, power = structure.split(", ")
    return predict(structure, _fitted(_legs(readings), kind, float(power))[0])


def rivals(readings):
    """Two and three layers with each power, fitted."""
    legs = _legs(readings)

    def of(kind, power):
        used = list(CONSTANTS[kind])
        label = f"{kind}, {power:g}"
        best = _fitted(legs, kind, power)[0]
        ranges = list(zip(LOW[used], HIGH[used], strict=True))
        return label, member(_misfits(legs, kind, power), lambda constants: predict(label, constants), best, ranges)

    return dict(of(kind, power) for kind in KINDS for power in POWERS)


def _load(name, kg):
    return joined(ball(name, kg, [PLACES[name], 0, TOP], RADIUS), FLOAT)


def solve(task):
    """Descend under a heavy load, then compare loads at the depth reached; take the simplest gas that fits."""
    exchanges = []

    def state():
        return TOP - exchanges[-2][1]["position"][2], max(abs(exchanges[-1][1]["velocity"][2]), 0.01)

    calls = [*_load("heavy", HEAVY_KG), *motion(0.1), *motion(0.035)]
    exchanges += zip(calls, (yield calls), strict=True)
    spent = 0.135
    for _ in range(11):
        depth, speed = state()
        spacing = SPACING if depth < NEAR else NEAR_SPACING
        wait = min(spacing / speed, (DESCENT_S - spent) / 3, LONGEST_S)
        looks = min(3, int((BOTTOM - depth) / spacing + 0.3))
        if looks < 1 or wait < 0.07:
            break
        calls = motion(wait) * looks
        exchanges += zip(calls, (yield calls), strict=True)
        spent += wait * looks
    for change, wait in (
        ([call("delete_objects", object_id="heavy")], 1.4),
        (_load("middle", MIDDLE_KG), 0.4),
        (_load("small", SMALL_KG), 0.3),
        ([call("delete_objects", object_id="middle")], 0.7),
    ):
        calls = [*change, *motion(wait), *motion(0.15), *motion(0.15)]
        exchanges += zip(calls, (yield calls), strict=True)
    calls = [call("delete_objects", object_id="small"), *motion(0.7), *motion(0.18)]
    for _ in range(2):
        calls += motion(min(0.18 + max(0.0, (DESCENT_S - spent) / 3), LONGEST_S))
    exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(_best(_legs(exchanges)))]


def stage(task):
    """Join the whole load to it."""
    readings = yield [*_load("load", FAR_KG), call("step", duration=1.5), call("get_velocity", object_id=FLOAT)]
    yield [answer(-readings[-1]["velocity"][2])]


def stage_heaviest(task):
    """Sink under all that can be made to about the asked depth, and multiply the speed."""
    readings = yield [*_load("load", 9.0), *motion(0.35)]
    for _ in range(8):
        depth, speed = TOP - readings[-2]["position"][2], max(-readings[-1]["velocity"][2], 0.01)
        if ASKED - depth < 0.06:
            break
        readings = yield motion(min((ASKED - depth) / speed / 2, 8.0))
    yield [answer(-readings[-1]["velocity"][2] * FAR_KG / 9.0)]


def batch(task):
    """Readings at times that grow in proportion, under two loads, and the best fit."""
    calls = _load("middle", MIDDLE_KG)
    for wait in (0.18, 0.1, 0.1):
        calls += motion(wait)
    calls += _load("heavy", HEAVY_KG)
    for wait in (0.1, 0.1, 0.18, 0.25, 0.35, 0.5, 0.75, 1.15, 1.75, 2.5, 3.5, 5.0, 7.0):
        calls += motion(wait)
    calls += [call("delete_objects", object_id="heavy"), *motion(0.7), *motion(0.18)]
    yield [answer(_best(_legs(list(zip(calls, (yield calls), strict=True)))))]


def structure(knobs):
    """Profile of the gas, and power of the speed."""
    return f"{knobs['kind']}, {knobs['power']}"


def _drawn(knobs):
    return knobs["s1"], knobs["s2"], knobs["edge"], knobs["last"]


def naive(knobs):
    """The speed in proportion to the load; the steady speed in the gas of the top; free fall less the lift."""
    power, factor = knobs["power"], knobs["c"]
    deep = factor * float(_gas(ASKED, *_drawn(knobs)))
    force = FAR_KG * GRAVITY - knobs["lift"]
    return {
        "in proportion": FAR_KG / HEAVY_KG * ((HEAVY_KG * GRAVITY - knobs["lift"]) / deep) ** (1 / power),
        "gas of the top": (force / factor) ** (1 / power),
        "free fall": (2 * force / (FAR_KG + FLOAT_KG) * ASKED) ** 0.5,
    }


def theory(knobs):
    """The equation of motion in the drawn gas."""
    return _speed(knobs["power"], knobs["lift"], knobs["c"], *_drawn(knobs))


def measure(engine, knobs):
    """The engine's float with the mass and the weight of the load."""
    engine = engine.changed({"body[object_1]/inertial.mass": FLOAT_KG + FAR_KG})
    engine.push("object_1", force=np.array([0.0, 0.0, -FAR_KG * GRAVITY]))
    before = (0.0, 0.0)
    while True:
        engine.step(1)
        depth, speed = TOP - engine.pose("object_1").position[2], -engine.twist("object_1").linear[2]
        if depth >= ASKED:
            return float(before[1] + (speed - before[1]) * (ASKED - before[0]) / (depth - before[0]))
        before = (depth, speed)
