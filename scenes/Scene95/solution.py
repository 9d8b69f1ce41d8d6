"""Scene 95: throw the wheel out of balance more and more below the guard, fit each kind of springs, predict."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.courses import refined
from scenes.family import member
from scenes.fitting import chi_square
from scenes.protocol import answer, call

SPIN, GUARD_M = 9.0, 0.2
FAR_SPIN, FAR_M, FAR_S, OFF_M = 3.0, 0.6, 4.0, 1.0
STRUCTURES = {"stiffer": ("m", "w", "c", "b"), "gap": ("m", "w", "c", "g", "a"), "softer": ("m", "w", "c", "s")}
BOX = {"m": (0.05, 300), "w": (6, 90), "c": (0.03, 3), "b": (2.7, 40), "g": (0.5, 8), "a": (0.04, 0.14), "s": (0.1, 1)}
"""Mass; over it, force of the springs per distance near x = 0, and resistance; the numbers of each kind."""
SIGMA_M, SIGMA_M_S = 3e-4, 1e-3
HEIGHT_M, DENSITY, PLACE_M = 1.3, 1e4, 0.5
FIRST_KG, LADDER, VISIBLE_M_S, LOOK_S = 0.0005, 4.0, 0.025, 0.2
TURNS, LOOKS, CALLS = 12, 3, 150
SHARES = np.geomspace(0.002, 1.0, 20)
"""Masses of a ball over that of carriage and wheel that are considered."""
NEAR_M = 0.183
STARTS = 4
"""Number of points from which a fit is begun."""


def _back(structure, knobs, x):
    """Force of the springs towards x = 0 over the mass."""
    far = np.abs(x)
    if structure == "stiffer":
        pull = far * (1 + knobs["b"] * far**2)
    elif structure == "gap":
        pull = far + knobs["g"] * np.maximum(far - knobs["a"], 0.0)
    else:
        pull = far / (1 + far / knobs["s"])
    return knobs["w"] * pull * np.sign(x)


def _moved(structure, knobs, place, speed, load, off, spin, time, longest=0.04):
    """Place and speed after a time, by the Runge-Kutta method; `load` [kg] is joined, `off` [kg m] out of balance."""
    count = max(1, int(np.ceil(np.max(time) / longest)))
    h, mass = time / count, knobs["m"]
    held, whole = np.exp(1j * spin * h / 2), 1 + load / mass

    def pull(x, v, turned):
        return (turned.real * spin**2 / mass - _back(structure, knobs, x) - knobs["c"] * v) / whole

    for _ in range(count):
        middle, end = off * held, off * held**2
        a = pull(place, speed, off)
        b = pull(place + h / 2 * speed, speed + h / 2 * a, middle)
        c = pull(place + h / 2 * speed + h * h / 4 * a, speed + h / 2 * b, middle)
        d = pull(place + h * speed + h * h / 2 * b, speed + h * c, end)
        place = np.clip(place + h * speed + h * h / 6 * (a + b + c), -9, 9)
        speed, off = np.clip(speed + h / 6 * (a + 2 * b + 2 * c + d), -99, 99), end
    return place, speed


def _joined(mass, speed, load, fresh, fresh_off):
    """Speed after balls that were at rest were joined; `load` counts all balls that are joined then."""
    return ((mass + load - fresh) * speed + SPIN * fresh_off.imag) / (mass + load)


def _rows(exchanges):
    """Rows of: duration; load and imbalance, then those that are new, at its start; place and speed at its end."""
    rows, made, joined, time, place, fresh = [], {}, {}, 0.0, 0.0, 0j
    new = 0.0
    for asked, reading in exchanges:
        given = asked.arguments
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[given["name"]] = (given["density"] * 4 / 3 * pi * given["radius"] ** 3, given["pos"])
        elif asked.tool == "attach_objects":
            kg, (x, y, _) = made[given["object1_id"]]
            off = kg * complex(x - place, y)
            joined[given["object1_id"]] = kg, off * np.exp(-1j * SPIN * time)
            new, fresh = new + kg, fresh + off
        elif asked.tool == "delete_objects":
            joined.pop(given["object_id"])
        elif asked.tool == "step":
            load, off = (sum(part) for part in zip((0.0, 0j), *joined.values(), strict=True))
            rows.append([given["duration"], load, off * np.exp(1j * SPIN * time), new, fresh])
            time, new, fresh = time + given["duration"], 0.0, 0j
        elif asked.tool == "get_position":
            place = reading["position"][0]
            rows[-1].append(place)
        elif asked.tool == "get_velocity":
            rows[-1].append(reading["velocity"][0])
    caught = next((at for at, row in enumerate(rows) if abs(row[5]) > 0.995 * GUARD_M), len(rows))
    return np.array(rows[: max(caught, 1)])


def _knobs(structure, unit):
    """Constants at points of the unit cube."""
    names = STRUCTURES[structure]
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(names, unit, strict=True)}


def _by_legs(rows, structure, unit=None):
    """Chi-square of the best fit to each leg from the readings before it, and its constants in the unit cube."""
    time, load, off, new, fresh, place, speed = rows.T[:, :, None]
    time, load, new, place, speed = (part.real for part in (time, load, new, place, speed))
    x, v = np.vstack([[[0.0]], place[:-1]]), np.vstack([[[0.0]], speed[:-1]])
    turn = np.minimum(6.0 * time, pi / 2)
    wrong = np.sqrt(SIGMA_M**2 * (1 + np.cos(turn) ** 2) + (SIGMA_M_S / 6.0 * np.sin(turn)) ** 2)
    off_by = np.sqrt(SIGMA_M_S**2 * (1 + np.cos(turn) ** 2) + (SIGMA_M * 6.0 * np.sin(turn)) ** 2)

    def misfits(units):
        knobs = _knobs(structure, units)
        at, fast = _moved(
            structure, knobs, x + 0 * units[0], _joined(knobs["m"], v, load, new, fresh), load, off, SPIN, time
        )
        return np.vstack([(at - place) / wrong, (fast - speed) / off_by, 0.3 * (units - 0.5)])

    if unit is None:
        units = np.random.default_rng(1).random((len(STRUCTURES[structure]), 300))
        order = np.argsort(np.log1p(misfits(units) ** 2).sum(axis=0))[:STARTS]
        found = [refined(misfits, units[:, start], 15) for start in order]
        unit = min(found, key=lambda point: chi_square(misfits, point))
    unit = refined(misfits, unit, 8)
    return float((misfits(unit[:, None]) ** 2).sum()), unit


def _whole(rows, structure):
    """Misfits of the course as a whole, and a weak pull to the middle, at points of the unit cube."""

    def misfits(units):
        knobs, off_by = _knobs(structure, units), []
        x, v = np.zeros(units.shape[1]), np.zeros(units.shape[1])
        for time, load, off, new, fresh, place, speed in rows:
            v = _joined(knobs["m"], v, load.real, new.real, fresh)
            x, v = _moved(structure, knobs, x, v, load.real, off, SPIN, time.real)
            off_by += [(x - place.real) / SIGMA_M, (v - speed.real) / SIGMA_M_S]
        return np.vstack([*off_by, 0.3 * (units - 0.5)])

    return misfits


def _best_unit(rows, structure):
    """Chi-square and constants of the best fit to the course as a whole, in the unit cube."""
    misfits = _whole(rows, structure)
    unit = refined(misfits, _by_legs(rows, structure)[1], 5)
    return float((misfits(unit[:, None]) ** 2).sum()), unit


def predict(structure, knobs, *, carried=True):
    """Least mass of the ball with which the carriage comes far enough."""
    low, high = 0.005, 8.0
    for _ in range(2):
        shares = np.geomspace(low, high, 200)
        x, v, far = np.zeros(200), np.zeros(200), np.zeros(200)
        off, step = knobs["m"] * shares * OFF_M + 0j, 0.02
        for moment in range(round(FAR_S / step)):
            turned = off * np.exp(1j * FAR_SPIN * step * moment)
            x, v = _moved(structure, knobs, x, v, knobs["m"] * shares * carried, turned, FAR_SPIN, step)
            far = np.maximum(far, np.abs(x))
        first = int(np.argmax(far >= FAR_M)) if far.max() >= FAR_M else 199
        low, high = shares[max(first - 1, 0)], shares[first]
    return float(knobs["m"] * high)


def _best(rows):
    """The answer by the kind of springs that fits best, each constant paid for."""
    found = {structure: _best_unit(rows, structure) for structure in STRUCTURES}
    name = min(found, key=lambda name: found[name][0] + 4 * len(STRUCTURES[name]))
    return predict(name, _knobs(name, found[name][1]))


def fit(readings, structure):
    """The asked mass with one kind of springs."""
    return predict(structure, _knobs(structure, _best_unit(_rows(readings), structure)[1]))


def rivals(readings):
    """Each kind of springs, fitted."""
    rows = _rows(readings)
    return {structure: _weighed(rows, structure) for structure in STRUCTURES}


def _weighed(rows, structure):
    """The springs of one kind, fitted within the ranges of their constants."""
    whole, size = _whole(rows, structure), len(STRUCTURES[structure])

    def misfits(unit):
        return whole(np.asarray(unit)[:, None])[:-size, 0]

    start = np.clip(_best_unit(rows, structure)[1], 1e-4, 1 - 1e-4)
    best = least_squares(misfits, start, bounds=(0.0, 1.0), diff_step=1e-4, max_nfev=8).x
    return member(misfits, lambda unit: predict(structure, _knobs(structure, unit)), best, [(0.0, 1.0)] * size)


def naive(knobs):
    """Springs as near x = 0; the ball shakes the carriage, but is not carried along."""
    return {
        "springs as near x = 0": predict("stiffer", {**knobs, "b": 0.0}),
        "ball not carried along": predict(knobs["kind"], knobs, carried=False),
    }


def _ball(number, kg, place, direction):
    """A ball joined to the wheel."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [place + PLACE_M * np.cos(direction), PLACE_M * np.sin(direction), HEIGHT_M]
    made = call(
        "create_objects",
        name=f"b{number}",
        pos=[round(float(part), 4) for part in where],
        density=DENSITY,
        rgba=[1, 0, 0, 1],
        radius=float(radius),
    )
    return [made, call("attach_objects", object1_id=f"b{number}", object2_id="object_2")]


def _look(duration):
    return [
        call("step", duration=duration),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def _chosen(fits, place, speed, wanted):
    """Share of the mass and direction of a ball that carries the carriage this far and no farther, gone or not then."""
    shares, directions = (part.ravel() for part in np.meshgrid(SHARES, np.arange(8) * pi / 4))
    lightest = min(knobs["m"] for knobs in fits.values())
    load = shares * lightest
    far = np.zeros(len(load))
    for structure, knobs in fits.items():
        off = load * PLACE_M * np.exp(1j * directions)
        x, v = place + 0 * load, _joined(knobs["m"], speed, load, load, off)
        for moment in range(round((LOOKS + 2) * LOOK_S / 0.05)):
            gone = moment >= round(LOOKS * LOOK_S / 0.05)
            x, v = _moved(structure, knobs, x, v, load * (not gone), off * (not gone), SPIN, 0.05)
            off = off * np.exp(1j * SPIN * 0.05)
            far = np.maximum(far, np.abs(x))
    best = int(np.argmin(np.where(far < wanted, wanted - far, 10 * (far - wanted))))
    return float(load[best]), float(directions[best])


def solve(task):
    """Heavier and heavier balls until the carriage moves; then balls that the models so far choose."""
    seen, number, kg, place = [], 0, FIRST_KG, 0.0
    while True:
        gone = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
        calls = [*gone, *_ball(number, kg, place, 0.0), *_look(LOOK_S)]
        seen += zip(calls, (yield calls), strict=True)
        number, kg, place = number + 1, kg * LADDER, seen[-2][1]["position"][0]
        if abs(seen[-1][1]["velocity"][0]) > VISIBLE_M_S:
            break
    calls = _look(LOOK_S)
    seen += zip(calls, (yield calls), strict=True)
    units = dict.fromkeys(STRUCTURES)
    for turn in range(TURNS):
        rows = _rows(seen)
        found = {structure: _by_legs(rows, structure, units[structure]) for structure in STRUCTURES}
        least = min(cost for cost, _ in found.values())
        units = {structure: unit if turn > 4 else None for structure, (_, unit) in found.items()}
        fits = {name: _knobs(name, unit) for name, (cost, unit) in found.items() if cost < 2 * least + 50}
        widest = float(np.abs(rows[:, 5]).max())
        place, speed = (float(part) for part in rows[-1, 5:].real)
        kg, direction = _chosen(fits, place, speed, min(0.02 + 1.7 * widest, NEAR_M))
        calls = [call("delete_objects", object_id=f"b{number - 1}"), *_ball(number, kg, place, direction)]
        calls += [asked for _ in range(LOOKS) for asked in _look(LOOK_S)]
        if len(seen) + len(calls) > CALLS:
            break
        number += 1
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_best(_rows(seen)))]


def batch(task):
    """Heavier and heavier balls, each besides those before, and the same fit."""
    calls = []
    for number in range(11):
        calls += [*_ball(number, 0.001 * 2.3**number, 0.0, SPIN * 0.3 * number + 0.6 * number), *_look(0.3)]
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows))]


def stage(task):
    """Ever heavier balls, until the guard acts."""
    kg, number, far = 0.01, 0, 0.0
    while far < 0.15 and number < 14:
        readings = yield [*_ball(number, kg, 0.0, SPIN * 0.3 * number), *_look(0.3)]
        far, kg, number = abs(readings[-2]["position"][0]), 1.6 * kg, number + 1
    yield [answer(kg * FAR_M / max(far, 0.02) * PLACE_M / OFF_M)]


def measure(engine, knobs):
    """The engine's carriage and wheel with the ball, without the guard."""

    def farthest(load):
        mass = 0.1 * knobs["m"] + load
        changes = {
            "body[object_2]/inertial.mass": mass,
            "body[object_2]/inertial.pos": (load * OFF_M / mass, 0.0, 0.0),
            "body[trigger]/inertial.mass": 1e9,
            "key[start].qvel": (0.0, FAR_SPIN, 0.0, 0.0),
        }
        world, far = engine.changed(changes), 0.0
        for _ in range(world.whole_steps(FAR_S)):
            world.step(1)
            far = max(far, abs(float(world.pose("object_1").position[0])))
        return far

    low, high = 0.95 * predict(knobs["kind"], knobs), 1.05 * predict(knobs["kind"], knobs)
    for _ in range(9):
        middle = (low + high) / 2
        low, high = (low, middle) if farthest(middle) >= FAR_M else (middle, high)
    return (low + high) / 2
