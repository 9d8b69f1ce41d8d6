"""Scene 91: accelerate and slow down the drum by different loads, and fit inertia and resistance to its energy."""

from math import sqrt

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, dense_ball, hung, joined, mass_of
from scenes.protocol import answer, call
from scenes.rigs import motion

PAN = "object_2"
PAN_KG, FAR_KG, MADE_KG = 0.1, 8.0, 4.9
"""Masses of the pan, of the load that is asked for, and of all balls together, at most, kg."""
FALL, WAY = 1.2, 1.38
"""Way that is asked for, and way after which the descent is over."""
TOP = 3.0
FAST, SLOW = 3.4, 0.7
"""Spins between which the drum is kept, rad/s."""
LADDER = (0.05, 0.05, 0.1, 0.2, 0.4, 0.4)
TRY_S, STRETCH = 0.15, 2.5
"""How long a load is tried; angle in which the spin is to change from slow to fast."""
KINDS = ("dry", "oil", "air")
READ_M = 6e-4
"""Standard deviation of a way that is read."""
FAST_NM, FAST_SPIN = (1.5, 8.0), 30.0
"""Between which torques a part that grows with the spin is, and at which spin, by the task."""
DENSITY = 1e4


def _look(duration):
    return [*motion(duration), call("get_position", object_id=PAN)]


def _load(name, kg, way=0.0):
    """Join a ball to the pan, close to it."""
    row, place = divmod(int(name[1:]), 5)
    return joined(dense_ball(name, kg, [0.1 * place - 0.2, 0.1 * row - 0.2, TOP - way], DENSITY), PAN)


def _stretches(exchanges):
    """Rows of: load before and after a change [kg], duration, angle and spin before, angle, spin and way after."""
    rows, before, state, on = [], 0.0, (0.0, 0.0, 0.0), 0.0
    for asked, reading, load in hung(exchanges):
        on = load[PAN]
        if asked.tool == "delete_objects":
            before = min(before, on)
        elif asked.tool == "get_velocity":
            spin = reading["angular_velocity"]
        elif asked.arguments.get("object_id") == "object_1" and "angle" in reading:
            angle = reading["angle"]
        elif asked.tool == "get_position":
            time, way = reading["sim_time"], TOP - reading["position"][2]
            if way < 1.47 and (not rows or rows[-1][7] < WAY):
                rows.append((before, on, time - state[0], *state[1:], angle, spin, way))
            state, before = (time, angle, spin), on
    return np.array(rows)


def _misfits(rows, kind):
    """Misfits of angles, spins and ways, as a function of radius, growth, logarithms of inertia and T0, and of c or k.

    Each stretch is integrated from the reading at its start; a ball that is joined is at rest before.
    """
    before, load, time, first, begun, last, ended, ways = rows.T
    pieces = 24
    step = time / pieces

    def misfits(values):
        radius, growth, inertia, dry, oil, air = _parts(kind, values)

        def change(angle, spin):
            r = radius + growth * angle
            torque = load * GRAVITY * r - (load + PAN_KG) * r * growth * spin**2 - dry - oil * spin - air * spin**2
            return torque / (inertia + (load + PAN_KG) * r * r)

        square = (radius + growth * first) ** 2
        angle, spin = first, begun * (inertia + (before + PAN_KG) * square) / (inertia + (load + PAN_KG) * square)
        for _ in range(pieces):
            middle = np.maximum(spin + step / 2 * change(angle, spin), 0.0)
            spin = np.maximum(spin + step * change(angle + step / 2 * spin, middle), 0.0)
            angle = angle + step * middle
        of_angle = (angle - last) / (2e-3 + 4e-4 * time)
        of_spin = (spin - ended) / (2.2e-3 + 5e-4 * np.abs(ended - begun))
        return np.concatenate([of_angle, of_spin, (radius * last + growth * last**2 / 2 - ways) / READ_M])

    return misfits


def _parts(kind, values):
    """Radius, its growth per angle, inertia, T0, c and k."""
    radius, growth, inertia, dry, *grow = values
    oil, air = (grow[0] if kind == name else 0.0 for name in KINDS[1:])
    return radius, growth, np.exp(inertia), np.exp(dry), oil, air


def _ranges(rows, kind):
    """Smallest and largest values of the constants, and some of them to begin with."""
    _, load, *_, last, _, ways = rows.T
    moved = last > 0.012
    if last.max() > 1:
        radius, growth = np.linalg.lstsq(np.column_stack([last, last**2 / 2]), ways, rcond=None)[0]
    else:
        radius, growth = (ways.sum() / last.sum() if moved.any() else 0.1), 0.0
    least = 0.75 * GRAVITY * radius * (load[moved][0] if moved.any() else 0.5)
    most = FAST_NM[1] / FAST_SPIN ** KINDS.index(kind)
    low = [0.04, -0.05, -4.5, np.log(least / 3), most * FAST_NM[0] / FAST_NM[1]]
    high = [0.16, 0.05, -0.7, np.log(least * 1.6), most]
    count = 4 if kind == "dry" else 5
    begin = [radius, growth, 0.0, np.log(least), 1.2 * low[-1]]
    return np.array(low[:count]), np.array(high[:count]), np.array(begin[:count])


def _fitted(rows, kind, inertias=(0.05, 0.15)):
    """The constants that fit best, and chi-square."""
    low, high, begin = _ranges(rows, kind)
    misfits, best = _misfits(rows, kind), None
    for inertia in inertias:
        begin[2] = np.log(inertia)
        start = np.clip(begin, 0.999 * low + 0.001 * high, 0.001 * low + 0.999 * high)
        found = least_squares(misfits, start, bounds=(low, high), x_scale=high - low, max_nfev=60)
        if best is None or found.cost < best.cost:
            best = found
    return best.x, 2 * best.cost


def _model(rows, kind, inertias=(0.05, 0.15)):
    """Misfit, and radius at the start, its growth per angle, inertia, T0, c, k by one kind of resistance."""
    values, cost = _fitted(rows, kind, inertias)
    return cost, _parts(kind, values)


def rivals(readings):
    """Each kind of resistance, fitted."""
    rows = _stretches(readings)

    def of(kind):
        low, high, _ = _ranges(rows, kind)
        best, _ = _fitted(rows, kind)
        ranges = list(zip(low, high, strict=True))
        return member(_misfits(rows, kind), lambda values: float(_speed(*_parts(kind, values))), best, ranges)

    return {kind: of(kind) for kind in KINDS}


def _best(rows):
    """The simplest resistance that fits, with the rest of the model."""
    found = {kind: _model(rows, kind) for kind in KINDS}
    return found[min(KINDS, key=lambda kind: found[kind][0] + (0 if kind == "dry" else 4))][1]


def _time_until(model, load, angle, spin, way):
    """Time until the drum is fast or slow enough or the pan low enough."""
    radius, growth, inertia, dry, oil, air = model
    time, step, fast = 0.0, 0.01, (FAST if angle > 1 else FAST / 2)
    while time < 1.5:
        r = radius + growth * angle
        rate = (load * GRAVITY * r - dry - oil * spin - air * spin**2) / (inertia + (load + PAN_KG) * r * r)
        if way > WAY or (rate > 0 and spin > fast) or (rate < 0 and spin < SLOW):
            break
        time, spin, angle, way = time + step, spin + step * rate, angle + step * spin, way + step * spin * r
    return max(time, 0.1)


def _speed(radius, growth, inertia, dry, oil, air):
    """Speed of the pan under the far load at the asked way, from the energy over the angle."""
    end = FALL / radius if abs(growth) < 1e-9 else (sqrt(radius**2 + 2 * growth * FALL) - radius) / growth
    angles = np.linspace(0, end, 1501)
    step = angles[1]
    energy = 0.0

    def change(angle, energy):
        r = radius + growth * angle
        square = 2 * max(energy, 0.0) / (inertia + (FAR_KG + PAN_KG) * r * r)
        return FAR_KG * GRAVITY * r - dry - oil * sqrt(square) - air * square

    for angle in angles[:-1]:
        middle = energy + step / 2 * change(angle, energy)
        energy += step * change(angle + step / 2, middle)
    r = radius + growth * end
    return r * sqrt(2 * max(energy, 0.0) / (inertia + (FAR_KG + PAN_KG) * r * r))


def fit(readings, structure):
    """The asked speed with one kind of resistance."""
    return _speed(*_model(_stretches(readings), structure)[1])


def solve(task):
    """Find a load that moves the drum; then alternate between one that drives it and one that lets it slow down."""
    exchanges, loads, spent = [], [], 0

    for kg in LADDER:
        calls = [*_load(f"a{spent}", kg), *_look(TRY_S)]
        loads.append((f"a{spent}", kg))
        spent += 1
        exchanges += zip(calls, (yield calls), strict=True)
        if _stretches(exchanges)[-1][5] > 0.012:
            break
    calls = [*_look(0.05), call("delete_objects", object_id=loads.pop()[0]), *_look(0.05), *_look(0.05)]
    exchanges += zip(calls, (yield calls), strict=True)
    driving = False
    while spent < 17 and len(exchanges) < 125:
        rows = _stretches(exchanges)
        model = free = _model(rows, "dry", (0.08,))[1]
        if rows[-1][5] > 1:
            model = _model(rows, "oil", (max(free[2], 0.03),))[1]
        *_, angle, spin, way = rows[-1]
        radius, growth, inertia, dry, oil, air = model
        here = radius + growth * angle
        if way > WAY:
            break
        extra = inertia * (FAST**2 - SLOW**2) / 2 / STRETCH
        on = sum(kg for _, kg in loads)
        driving = spin < SLOW + 0.3 or (driving and spin < FAST - 0.5)
        resisted = dry + oil * 2 + air * 4
        goal = max((resisted + (extra if driving else -extra)) / (GRAVITY * here), 0.0)
        goal = min(goal, 2.5 * max(rows[:, 1]) + 0.1)
        calls = []
        if driving and on < 0.95 * goal:
            made = sum(mass_of(asked) for asked, _ in exchanges if asked.tool == "create_objects")
            loads.append((f"a{spent}", float(min(goal - on, max(MADE_KG - made, 0.01)))))
            calls += _load(*loads[-1], way)
        while not driving and loads and on > 1.05 * goal:
            name, kg = loads.pop()
            on -= kg
            calls.append(call("delete_objects", object_id=name))
        spent += 1
        on = sum(kg for _, kg in loads)
        time = min(_time_until(known, on, angle, spin, way) for known in (model, free))
        calls += [*_look(time / 2), *_look(time / 2)]
        exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(_speed(*_best(_stretches(exchanges))))]


def stage(task):
    """Join the whole load to it."""
    readings = yield [*_load("a0", FAR_KG), call("step", duration=1), call("get_velocity", object_id="object_2")]
    yield [answer(-readings[-1]["velocity"][2])]


def stage_heaviest(task):
    """Let it sink under a quarter of the load, and double the speed at the asked way."""
    readings = yield [*_load("a0", FAR_KG / 4), *_look(0.3)]
    for _ in range(12):
        if TOP - readings[-1]["position"][2] >= FALL:
            break
        readings = yield _look(0.1)
    readings = yield [call("get_velocity", object_id="object_2")]
    yield [answer(-2 * readings[-1]["velocity"][2])]


def batch(task):
    """A ladder of loads with short stretches, then less load."""
    calls = []
    for number, kg in enumerate(LADDER[:5]):
        calls += [*_load(f"a{number}", kg), *_look(0.1)]
    calls += [call("delete_objects", object_id="a4"), *_look(0.1), call("delete_objects", object_id="a3")]
    for time in (0.2, 0.4, 0.8, 1.0):
        calls += _look(time)
    readings = yield calls
    rows = _stretches(list(zip(calls, readings, strict=True)))
    rows = rows[: next((place for place, row in enumerate(rows) if row[6] > 4), len(rows))]
    try:
        value = _speed(*np.maximum(_best(rows), [0.05, -0.02, 0.01, 0, 0, 0]))
    except ValueError:  # on the way a fit may ask for a root of what is negative
        value = 1.0
    yield [answer(value)]


def structure(knobs):
    """Which part of the resistance grows with the spin."""
    return knobs["kind"]


def naive(knobs):
    """Without the part of the resistance that grows; with the radius of the start as well; and free of resistance."""
    parts = (knobs["radius"], knobs["r1"], knobs["inertia"], knobs["dry"])
    return {
        "resistance of slow turning": _speed(*parts, 0.0, 0.0),
        "even radius": _speed(parts[0], 0.0, parts[2], parts[3], knobs["c"], knobs["k"]),
    }


def theory(knobs):
    """The energy over the angle with the drawn values."""
    return _speed(knobs["radius"], knobs["r1"], knobs["inertia"], knobs["dry"], knobs["c"], knobs["k"])


def measure(engine, knobs):
    """The engine's pan with the mass and the weight of the load, without the safety device."""
    engine = engine.changed({"body[object_2]/inertial.mass": PAN_KG + FAR_KG, "joint[trigger_joint].damping": 1e6})
    engine.push("object_2", force=np.array([0.0, 0.0, -FAR_KG * GRAVITY]))
    before = (0.0, 0.0)
    while True:
        engine.step(1)
        fallen, speed = TOP - engine.pose("object_2").position[2], -engine.twist("object_2").linear[2]
        if fallen >= FALL:
            return float(before[1] + (speed - before[1]) * (FALL - before[0]) / (fallen - before[0]))
        before = (fallen, speed)
