"""Scene 44: the profile of the gas from one descent, the power and the lift from three loads at one depth."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY = 9.81
FLOAT_KG, FAR_KG = 2.0, 50.0
TOP, ASKED, BOTTOM = 40.0, 30.0, 32.5
"""Height of the start; depth that is asked for, and depth beyond which it may get into the trap."""
HEAVY_KG, MIDDLE_KG, SMALL_KG = 4.0, 1.5, 0.5
SPACING = 1.7
"""Way between two readings of a descent, m."""
DESCENT_S = 190.0
LONGEST_S = 60.0
EDGE = 0.7
POWERS, KINDS = (1.0, 1.5, 2.0), ("two layers", "three layers")
PARTS = {"two layers": 2, "three layers": 4}
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
    force, mass, step = FAR_KG * GRAVITY - lift, FLOAT_KG + FAR_KG, 0.002
    grid = 0.01
    gases = (factor * _gas(np.arange(0, ASKED + 1, grid), *profile)).tolist()

    def pull(depth, speed):
        cell, share = divmod(depth / grid, 1)
        gas = gases[int(cell)] * (1 - share) + gases[int(cell) + 1] * share
        return (force - gas * abs(speed) ** power) / mass

    depth = speed = 0.0
    while True:
        a = pull(depth, speed)
        b = pull(depth + step / 2 * speed, speed + step / 2 * a)
        way = step * (speed + step / 2 * a)
        if depth + way >= ASKED:
            return speed + b * step * (ASKED - depth) / way
        depth, speed = depth + way, speed + step * b


def _start(rows, kind, power):
    """Profile to start from: the edges between which the resistance is most nearly constant, at a lift of 8 N."""
    load, depth, speed, rate = rows.T
    force = load * GRAVITY - 8 - (FLOAT_KG + load) * rate
    own = (load > 3) & (speed > 0.01) & (force > 5)
    known, depth = np.log(force[own] / speed[own] ** power), depth[own]
    edges = np.arange(4.0, 30.0, 0.5)
    pairs = [(edges[0] - 9, edge) for edge in edges]
    if kind == "three layers":
        pairs = [(edge, last) for edge in edges for last in edges if last - edge >= 3.5]
    best = None
    for edge, last in pairs:
        columns = np.column_stack([np.ones(len(depth)), _beyond(depth, edge), _beyond(depth, last)])
        levels, *_ = np.linalg.lstsq(columns, known, rcond=1e-6)
        left = float(np.sum((known - columns @ levels) ** 2))
        if best is None or left < best[0]:
            best = (left, levels, edge, last)
    _, levels, edge, last = best
    if kind == "two layers":
        return levels[0] + levels[1], 0.0, np.exp(levels[2]) - 1, edge, last
    middle = np.exp(levels[1])
    return levels[0], middle - 1, middle * (np.exp(levels[2]) - 1), edge, last


def _fitted(rows, kind, power):
    """Misfit, and power, lift, factor and profile, for one kind of gas.

    Rows: load [kg], depth [m], sinking speed [m/s], its rate of change [m/s²].
    """
    rows = np.array(rows)
    load, depth, speed, rate = rows.T
    inertia = (FLOAT_KG + load) * rate
    level, first, second, edge, last = _start(rows, kind, power)

    def parts(values):
        lift, log_factor, change, other_change, edge, last = values
        return lift, np.exp(log_factor), change if kind == "three layers" else 0.0, other_change, edge, last

    def misfit(values):
        lift, factor, *profile = parts(values)
        force = load * GRAVITY - lift - inertia
        # The speed at which the resistance would be this force.
        drawn = np.abs(force / (factor * np.maximum(_gas(depth, *profile), 0.05))) ** (1 / power)
        error = np.hypot(0.003 * drawn, 0.0007) + 0.15 * np.abs(inertia) / (np.abs(force) + 1.0) * drawn
        return (np.sign(force) * drawn - speed) / error

    begin = [8.0, level, first, second, max(edge, 1.0), last]
    tried = least_squares(
        misfit, np.clip(begin, LOW, HIGH), bounds=(LOW, HIGH), x_scale=[2, 0.3, 0.3, 0.3, 1, 1], max_nfev=200
    )
    return 2 * tried.cost, (power, *parts(tried.x))


LOW, HIGH = [2, -8, -0.95, -9, 0, 2], [14, 9, 9, 9, 33, 34]
"""Bounds of lift, logarithm of the factor, changes of the resistance, and depths of the boundaries."""


def _best(rows):
    """The simplest gas that fits: its power, lift, factor and profile."""
    found = {(kind, power): _fitted(rows, kind, power) for kind in KINDS for power in POWERS}
    return found[min(found, key=lambda gas: found[gas][0] + 4 * PARTS[gas[0]])][1]


def _rows_of(exchanges):
    """Load, depth, sinking speed, its rate of change at each reading but the first under a load."""
    rows, masses, joined, time, before = [], {}, 0.0, 0.0, None
    depth = 0.0
    for asked, reading in exchanges:
        if asked.tool == "create_objects":
            masses[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            joined, before = joined + masses[asked.arguments["object1_id"]], None
        elif asked.tool == "delete_objects":
            joined, before = joined - masses[asked.arguments["object_id"]], None
        elif asked.tool == "get_position":
            depth = TOP - reading["position"][2]
        elif asked.tool == "get_velocity":
            speed, time = -reading["velocity"][2], reading["sim_time"]
            if before is not None and depth > 0.02:
                rows.append([joined, depth, speed, (speed - before[1]) / (time - before[0])])
            before = (time, speed)
    return _centred(rows)


def _centred(rows):
    """Replace each rate of change by the mean of those before and after it, under the same load."""
    rates = [row[3] for row in rows]
    for row, rate, after, following in zip(rows[:-1], rates[:-1], rates[1:], rows[1:], strict=True):
        if following[0] == row[0]:
            row[3] = (rate + after) / 2
    return rows


def fit(readings, structure):
    """The asked speed by the law of one kind of gas."""
    kind, power = structure.split(", ")
    return _speed(*_fitted(_rows_of(readings), kind, float(power))[1])


def _load(name, kg):
    density = kg / (4 / 3 * pi * RADIUS**3)
    return [
        call(
            "create_objects", name=name, pos=[PLACES[name], 0, TOP], density=density, rgba=[1, 0, 0, 1], radius=RADIUS
        ),
        call("attach_objects", object1_id=name, object2_id="object_1"),
    ]


def _look(duration):
    return [
        call("step", duration=duration),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Descend under a heavy load, then compare loads at the depth reached; take the simplest gas that fits."""
    exchanges = []

    def state():
        return TOP - exchanges[-2][1]["position"][2], max(abs(exchanges[-1][1]["velocity"][2]), 0.01)

    calls = [*_load("heavy", HEAVY_KG), *_look(0.3), *_look(0.1)]
    exchanges += zip(calls, (yield calls), strict=True)
    spent = 0.4
    for _ in range(9):
        depth, speed = state()
        wait = min(SPACING / speed, (DESCENT_S - spent) / 3, LONGEST_S)
        looks = min(3, int((BOTTOM - depth) / SPACING + 0.3))
        if looks < 1 or wait < 0.2:
            break
        calls = _look(wait) * looks
        exchanges += zip(calls, (yield calls), strict=True)
        spent += wait * looks
    for change, wait in (
        ([call("delete_objects", object_id="heavy")], 4.0),
        (_load("middle", MIDDLE_KG), 1.2),
        (_load("small", SMALL_KG), 0.8),
        ([call("delete_objects", object_id="middle")], 2.0),
    ):
        calls = [*change, *_look(wait), *_look(0.4), *_look(0.4)]
        exchanges += zip(calls, (yield calls), strict=True)
    calls = [call("delete_objects", object_id="small"), *_look(2.0), *_look(0.5)]
    for _ in range(2):
        calls += _look(min(0.5 + max(0.0, (DESCENT_S - spent) / 3), LONGEST_S))
    exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(_speed(*_best(_rows_of(exchanges))))]


def stage(task):
    """Join the whole load to it."""
    readings = yield [*_load("load", FAR_KG), call("step", duration=3), call("get_velocity", object_id="object_1")]
    yield [answer(-readings[-1]["velocity"][2])]


def stage_heaviest(task):
    """Sink under all that can be made to about the asked depth, and multiply the speed."""
    readings = yield [*_load("load", 6.0), *_look(1.0)]
    for _ in range(8):
        depth, speed = TOP - readings[-2]["position"][2], max(-readings[-1]["velocity"][2], 0.02)
        if ASKED - depth < 0.5:
            break
        readings = yield _look(min((ASKED - depth) / speed / 2, 25.0))
    yield [answer(-readings[-1]["velocity"][2] * FAR_KG / 6.0)]


def batch(task):
    """Readings at times that grow in proportion, under two loads, and the best fit."""
    calls = _load("middle", MIDDLE_KG)
    for wait in (0.5, 0.3, 0.3):
        calls += _look(wait)
    calls += _load("heavy", HEAVY_KG)
    for wait in (0.3, 0.3, 0.5, 0.7, 1.0, 1.5, 2.2, 3.3, 5.0, 7.0, 10.0, 14.0, 20.0):
        calls += _look(wait)
    calls += [call("delete_objects", object_id="heavy"), *_look(2.0), *_look(0.5)]
    readings = yield calls
    exchanges = [pair for pair in zip(calls, readings, strict=True) if "error" not in pair[1]]
    rows = [row for row in _rows_of(exchanges) if row[1] < 36.5]
    yield [answer(_speed(*_best(rows)))]


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
