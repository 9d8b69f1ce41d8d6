"""Scene 44: the upper gas from three loads at the top, the lower one from three just above the trap."""

from itertools import pairwise
from math import exp, log, tanh

import numpy as np

from scenes.family import member
from scenes.fitting import chi_square, polished
from scenes.loads import GRAVITY, ball, hung, joined
from scenes.protocol import answer, call
from scenes.rigs import motion

FLOAT = "object_1"
FLOAT_KG, FAR_KG, UNIT_N = 8.0, 75.0, 45.0
TOP, ASKED, TRAP, WIDTH = 6.0, 5.4, 5.49, 0.03
"""Height of the start; depths: asked for, beyond which it may be in the trap, and of the change of the gas [m]."""
SMALL_KG, MIDDLE_KG, HEAVY_KG = 1.5, 1.5, 3.0
RADIUS = 0.05
PLACES = {"small": 1, "middle": 2, "heavy": 3, "load": 4}
"""Where balls are made, beside the shaft [m]."""
NEAR, BELOW = 4.5, 5.08
"""Depths from which on the boundary may come, and at which it is passed [m]."""
QUICK_S, USED_S, LONGEST_S, CALLS = 40.0, 75.0, 25.0, 130
"""Time in which half of the load may bring it down, time that is used, and longest wait for a reading [s]; calls."""
LEAST_N, SPARE, SHORT = 4.0, 0.02, 0.14
"""Least lift; way that is left above the trap, and way between two decisions near it [m]."""
READ_M, READ_M_S = 9e-4, 3e-4
"""Standard deviations of a way and of a speed that are read."""
PARTS, FAR_STEP_S, MOST_STEPS = 32, 0.004, 5000
"""Parts of a leg in the fit; time step of the asked descent, and most of them."""
POWERS = (1.0, 1.25, 1.5, 1.75, 2.0)
RANGES = np.array([(4.0, 12.0), (log(0.04), log(1.4)), (4.0, 12.0), (log(0.018), log(1.7)), (4.5, 5.0)])
"""Of lift and logarithm of the speed under `UNIT_N` in the upper gas, the same in the lower one, and the boundary."""
LABELS = {f"{upper:g} over {lower:g}": (upper, lower) for upper in POWERS for lower in POWERS}


def _speed(powers, constants):
    """Speed under the far load at the asked depth: the equation of motion by the Runge-Kutta method."""
    (upper, lower), (lift, pace, low_lift, low_pace, edge) = powers, constants
    drag, low_drag = UNIT_N / exp(pace) ** upper, UNIT_N / exp(low_pace) ** lower
    weight, mass, step = FAR_KG * GRAVITY, FLOAT_KG + FAR_KG, FAR_STEP_S

    def rate(depth, speed):
        share, speed = (1 + tanh((depth - edge) / WIDTH)) / 2, max(speed, 0.0)
        return (
            weight - (1 - share) * (lift + drag * speed**upper) - share * (low_lift + low_drag * speed**lower)
        ) / mass

    depth = speed = 0.0
    for _ in range(MOST_STEPS):
        a = rate(depth, speed)
        b = rate(depth + step / 2 * speed, speed + step / 2 * a)
        c = rate(depth + step / 2 * (speed + step / 2 * a), speed + step / 2 * b)
        d = rate(depth + step * (speed + step / 2 * b), speed + step * c)
        way, gain = step * (speed + step / 6 * (a + b + c)), step / 6 * (a + 2 * b + 2 * c + d)
        if depth + way >= ASKED:
            return speed + gain * (ASKED - depth) / way
        depth, speed = depth + way, speed + gain
    return speed  # of a gas in which it hardly sinks


def predict(structure, constants):
    """The speed in two gases with these powers and constants."""
    return _speed(LABELS[structure], constants)


def _misfits(legs, structure):
    """Misfits of ways and speeds after each leg, as a function of constants, a column for each trial."""
    load, duration, depth, speed, last_depth, last_speed = (column[:, None] for column in legs.T)
    weight, mass, step = load * GRAVITY, FLOAT_KG + load, duration / PARTS
    upper, lower = LABELS[structure]
    mean, read = (last_depth - depth) / duration, ~np.isnan(last_speed)
    speed, last_speed = np.where(np.isnan(speed), mean, speed), np.where(read, last_speed, 0.0)
    depth_error = np.hypot(READ_M, 0.004 * (last_depth - depth))
    speed_error = np.hypot(READ_M_S, 0.006 * last_speed)

    def misfits(constants):
        lift, pace, low_lift, low_pace, edge = constants[:, None, :]
        drag, low_drag = UNIT_N * np.exp(-upper * pace), UNIT_N * np.exp(-lower * low_pace)

        def later(x, v, time):
            """The speed after a time in the gas of one depth, the resistance taken as even in the speed."""
            share, fast = (1 + np.tanh((x - edge) / WIDTH)) / 2, np.maximum(np.abs(v), 1e-9)
            above, below = (1 - share) * drag * fast ** (upper - 1), share * low_drag * fast ** (lower - 1)
            fall = np.maximum((upper * above + lower * below) / mass, 1e-6)
            force = weight - (1 - share) * lift - share * low_lift - (above + below) * v
            return v - np.expm1(-fall * time) / fall * force / mass

        x, v = depth + 0 * lift, speed + 0 * lift
        for _ in range(PARTS):
            v = later(x, v, step / 2)
            x = x + v * step
            v = later(x, v, step / 2)
        return np.concatenate([(x - last_depth) / depth_error, read * (v - last_speed) / speed_error])

    return misfits


def _fitted(legs, structure):
    """The constants that fit best, and chi-square, from several places of the boundary."""
    low, high = RANGES.T[:, :, None]
    misfits = _misfits(legs, structure)

    def units(points):
        return np.clip(np.nan_to_num(misfits(low + (high - low) * points), nan=1e4), -1e4, 1e4)

    paces = [_pace(legs, power, deep) for power, deep in zip(LABELS[structure], (False, True), strict=True)]
    starts = [
        (np.array([8.0, paces[0], 8.0, paces[1], edge]) - low[:, 0]) / (high - low)[:, 0] for edge in (4.6, 4.75, 4.9)
    ]
    start = min((np.clip(start, 0.0, 1.0) for start in starts), key=lambda start: chi_square(units, start))
    found = polished(units, start)
    return low[:, 0] + (high - low)[:, 0] * found, chi_square(units, found)


def _pace(legs, power, deep):
    """Logarithm of the speed under `UNIT_N` in a gas, from the last speed under the largest load there."""
    inside = legs[legs[:, 2] > BELOW - 0.05] if deep else legs[legs[:, 4] < NEAR]
    if not len(inside):
        return log(0.1)
    load, duration, depth, _, last, _ = inside[np.argmax(inside[:, 0] + 1e-3 * np.arange(len(inside)))]
    speed = (last - depth) / duration
    force = load * GRAVITY - 8.0
    return log(max(abs(speed), 1e-4)) - log(max(abs(force), 1.0) / UNIT_N) / power


def _best(legs):
    """The speed by the powers that fit best: the upper one is chosen first, since most legs are in the upper gas."""
    tried = {label: _fitted(legs, label) for label, powers in LABELS.items() if powers[1] == 1.5}
    upper = LABELS[min(tried, key=lambda name: tried[name][1])][0]
    tried = {label: _fitted(legs, label) for label, powers in LABELS.items() if powers[0] == upper}
    label = min(tried, key=lambda name: tried[name][1])
    return predict(label, tried[label][0])


def _legs(exchanges):
    """Rows of load [kg], duration [s], depth [m] and sinking speed [m/s] at the start and at the end of each leg.

    A speed that was not read is NaN. Legs that begin with a ball joined to the moving float are left out, because its
    speed after that is not read.
    """
    states, legs = [(0.0, 0.0, 0.0, 0.0)], []
    for asked, reading, load in hung(exchanges):
        if asked.tool == "step":
            states.append((reading["sim_time"], np.nan, np.nan, load[FLOAT]))
        elif asked.tool == "get_position":
            states[-1] = (states[-1][0], TOP - reading["position"][2], *states[-1][2:])
        elif asked.tool == "get_velocity":
            states[-1] = (*states[-1][:2], -reading["velocity"][2], states[-1][3])
    for before, now in pairwise(states):
        joins = now[3] > before[3] and before[0] > 0
        if 3e-3 < now[1] < TRAP and before[1] < TRAP and not joins:
            legs.append([now[3], now[0] - before[0], *before[1:3], *now[1:3]])
    return np.array(legs)


def fit(readings, structure):
    """The asked speed by the laws with these powers."""
    return predict(structure, _fitted(_legs(readings), structure)[0])


def rivals(readings):
    """Each pair of powers, fitted."""
    legs = _legs(readings)

    def of(label):
        misfits = _misfits(legs, label)
        best = _fitted(legs, label)[0]
        return member(lambda constants: misfits(constants[:, None])[:, 0], lambda at: predict(label, at), best, RANGES)

    return {label: of(label) for label in LABELS}


def _load(name, kg):
    return joined(ball(name, kg, [PLACES[name], 0, TOP], RADIUS), FLOAT)


def _wait(way, speed):
    return round(min(max(way / max(abs(speed), 1e-3), 0.01), LONGEST_S) / 0.005) * 0.005


def _half(way, speed, gain):
    """Half the time of a way from a speed on, if the speed goes on to gain this much in a second [s]."""
    return _wait(way / 2, (speed + (speed**2 + 2 * max(gain, 0.0) * way) ** 0.5) / 2)


def _gain(seen):
    """Gain of the sinking speed in a second, between the last two looks.

    It is not exceeded later on, as long as the float stays in the gas and no load is added.
    """
    return (seen[-4][1]["velocity"][2] - seen[-1][1]["velocity"][2]) / seen[-3][0].arguments["duration"]


def _braking(kg):
    """Way in which the float stops without this load, over the square of its steady speed under it [s²/m].

    Of all gases, that with the power 2 and the least lift takes longest to stop it.
    """
    weight = kg * GRAVITY
    return FLOAT_KG / 2 / (weight - LEAST_N) * log(weight / LEAST_N)


def solve(task):
    """Three loads at the top; down under a load that fits the gas; above the trap, take the load off in parts."""
    seen, spent = [], 0.0

    def done(calls):
        nonlocal spent
        seen.extend(zip(calls, (yield calls), strict=True))
        spent = seen[-1][1]["sim_time"]
        return TOP - seen[-2][1]["position"][2], abs(seen[-1][1]["velocity"][2])

    depth, speed = yield from done([*_load("small", SMALL_KG), *motion(0.3)])
    depth, speed = yield from done(motion(_wait(0.08, speed)) * 2)
    depth, middle = yield from done([*_load("middle", MIDDLE_KG), *motion(_wait(0.1, 3 * speed)) * 2])
    depth, speed = yield from done([*_load("heavy", HEAVY_KG), *motion(_wait(0.12, 2 * middle)) * 2])
    parts = {"heavy": HEAVY_KG, "middle": MIDDLE_KG, "small": SMALL_KG}
    leave = []
    if BELOW / middle < QUICK_S:
        leave = [call("delete_objects", object_id="heavy")]
        del parts["heavy"]
    braking = _braking(sum(parts.values()))

    def room():
        return TRAP - SPARE - depth - braking * speed**2

    while depth < BELOW and room() > 0.7 * SHORT:
        way = min(SHORT, room() - SHORT / 3) if depth > NEAR - 0.2 else NEAR - depth
        depth, speed = yield from done([*leave, *(motion(_half(way, speed, _gain(seen))) * 2)])
        leave = []
    for part in (None, *parts):
        calls = [call("delete_objects", object_id=part)] if part else []
        depth, speed = yield from done(calls + motion(_wait(min(0.05, max(room(), 0.0) / 8), speed)) * 2)
    for way in (0.15, 0.3):
        if depth > 0.1 and spent < USED_S and len(seen) + 15 < CALLS:
            depth, speed = yield from done(motion(min(_wait(way, speed), _wait(USED_S - spent, 5))) * 5)
    yield [answer(_best(_legs(seen)))]


def stage(task):
    """Join the whole load to it."""
    readings = yield [*_load("load", FAR_KG), call("step", duration=1), call("get_velocity", object_id=FLOAT)]
    yield [answer(-readings[-1]["velocity"][2])]


def stage_heaviest(task):
    """Sink under all that can be made to about the asked depth, and multiply the speed."""
    readings = yield [*_load("load", 6.5), *motion(0.3)]
    for _ in range(12):
        depth, speed = TOP - readings[-2]["position"][2], max(-readings[-1]["velocity"][2], 0.01)
        if ASKED - depth < 0.1:
            break
        readings = yield motion(min((ASKED - depth) / speed / 2, 20.0))
    yield [answer(-readings[-1]["velocity"][2] * FAR_KG / 6.5)]


RATIO = 1.15
"""Of two moments at which the fixed batch looks."""


def batch(task):
    """Three loads at the top; then places at times in even ratios while it sinks under all of them; the best fit."""
    calls = [*_load("small", SMALL_KG), *motion(0.6), *motion(0.3), *_load("middle", MIDDLE_KG), *motion(0.3)]
    calls += [*_load("heavy", HEAVY_KG), *motion(0.3)]
    time = 4.0
    for _ in range(20):
        calls += motion(round(time * (RATIO - 1) / 0.005) * 0.005)[:2]
        time *= RATIO
    yield [answer(_best(_legs(list(zip(calls, (yield calls), strict=True)))))]


def structure(knobs):
    """Powers of the speed in the upper and in the lower gas."""
    return f"{knobs['upper']:g} over {knobs['lower']:g}"


def naive(knobs):
    """The speed in proportion to the load; the steady speed in the gas of the top; free fall less the lift."""
    force, near = FAR_KG * GRAVITY, 6.0 * GRAVITY - knobs["low_lift"]
    return {
        "in proportion": FAR_KG / 6.0 * (near / knobs["c2"]) ** (1 / knobs["lower"]),
        "gas of the top": ((force - knobs["lift"]) / knobs["c1"]) ** (1 / knobs["upper"]),
        "free fall": (2 * force / (FAR_KG + FLOAT_KG) * ASKED) ** 0.5,
    }


def theory(knobs):
    """The equation of motion in the drawn gases."""
    constants = [knobs["lift"], log(knobs["v1"]), knobs["low_lift"], log(knobs["v2"]), knobs["edge"]]
    return _speed((knobs["upper"], knobs["lower"]), constants)


def measure(engine, knobs):
    """The engine's float with the mass and the weight of the load."""
    engine = engine.changed({"body[object_1]/inertial.mass": FLOAT_KG + FAR_KG})
    engine.push(FLOAT, force=np.array([0.0, 0.0, -FAR_KG * GRAVITY]))
    before = (0.0, 0.0)
    while True:
        engine.step(1)
        depth, speed = TOP - engine.pose(FLOAT).position[2], -engine.twist(FLOAT).linear[2]
        if depth >= ASKED:
            return float(before[1] + (speed - before[1]) * (ASKED - before[0]) / (depth - before[0]))
        before = (depth, speed)
