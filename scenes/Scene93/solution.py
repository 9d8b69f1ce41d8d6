"""Scene 93: places of rest and slow ways give the law of the housing; the energy of the long way gives the mass."""

from math import pi

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

GRAVITY, TOP = 9.81, 2.0
ASKED, DEEP, FAST = 0.6, 0.2, 0.06
RADIUS = 0.15
LAWS = ("stiff", "air", "soft")
READ_M, READ_V = 1.5e-4, 9e-4
"""Errors of a reading."""
FIRST_KG, LADDER_S = 0.004, 0.3
SPANS_S = (0.3, 0.7)
"""Times after the two loads of an iteration."""
TURNS = 19
"""Iterations before the answer."""
SEEN, HIGH, SLOW = 0.003, 0.19, 0.05
"""Way that tells the scale; deepest place and greatest speed that are aimed at."""


def _look(duration):
    return [
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def _load(number, kg, depth=0.0):
    """Join a ball to the pan."""
    row, place = divmod(number, 5)
    made = call(
        "create_objects",
        name=f"a{number}",
        pos=[0.35 * place - 0.7, 0.35 * row - 0.7, TOP - depth],
        density=kg / (4 / 3 * pi * RADIUS**3),
        rgba=[1, 0, 0, 1],
        radius=RADIUS,
    )
    return [made, call("attach_objects", object1_id=f"a{number}", object2_id="object_1")]


def _rows(exchanges):
    """Rows of: load before and after a change [kg], duration, depth and sinking speed before and after."""
    rows, masses, before, depth, speed = [], {}, 0.0, 0.0, 0.0
    made, time = {}, 0.0
    for asked, reading in exchanges:
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * RADIUS**3
        elif asked.tool == "attach_objects":
            masses[asked.arguments["object1_id"]] = made[asked.arguments["object1_id"]]
        elif asked.tool == "delete_objects":
            masses.pop(asked.arguments["object_id"])
            before = min(before, sum(masses.values()))
        elif asked.tool == "step":
            time = asked.arguments["duration"]
        elif asked.tool == "get_position":
            last = TOP - reading["position"][2]
        elif asked.tool == "get_velocity":
            load = sum(masses.values())
            rows.append((before, load, time, depth, speed, last, -reading["velocity"][2]))
            before, depth, speed = load, last, rows[-1][6]
    return np.array(rows)


def _pull(depth, speed, load, model):
    """Acceleration downward."""
    k, curve, cube, oil, pan = model
    depth, speed = np.clip(depth, -1.0, 1.0), np.clip(speed, -20.0, 20.0)
    return (load * GRAVITY - k * depth * (1 + cube * depth**2) / np.maximum(1 - curve * depth, 0.05) - oil * speed) / (
        load + pan
    )


def _moved(depth, speed, load, time, model, longest=0.03):
    """Depth and speed after a time, by the Runge-Kutta method."""
    count = max(1, int(np.ceil(np.max(time) / longest)))
    h = time / count
    for _ in range(count):
        a = _pull(depth, speed, load, model)
        b = _pull(depth + h / 2 * speed, speed + h / 2 * a, load, model)
        c = _pull(depth + h / 2 * speed + h * h / 4 * a, speed + h / 2 * b, load, model)
        d = _pull(depth + h * speed + h * h / 2 * b, speed + h * c, load, model)
        depth, speed = depth + h * speed + h * h / 6 * (a + b + c), speed + h / 6 * (a + 2 * b + 2 * c + d)
    return depth, speed


def _problem(rows, law):
    """Model of the values of a law, their misfits with those of what is known beforehand, their ranges and a start."""
    load, last = rows[:, 1], rows[:, 5]
    tripped = (load >= rows[:, 0]) & (last < 0.4 * rows[:, 3]) | (last > DEEP) | (np.abs(rows[:, 6]) > FAST)
    rows = rows[: np.argmax(tripped) if tripped.any() else len(rows)]
    rows = rows[rows[:, 5] > 0.1 * rows[:, 5].max()]
    before, load, time, depth, speed, last, ended = rows.T
    stiff = float(load[-1] * GRAVITY / max(last[-1], 1e-3))

    def model(values):
        k = np.exp(values[0])
        curve = {"air": values[1], "soft": -values[1], "stiff": 0.0, "any": values[1]}[law]
        return k, curve, 6 * values[1] if law == "stiff" else 0.0, values[2] * 0.4 * k, values[3] * k / GRAVITY

    def misfit(values):
        *_, pan = parts = model(values)
        begun = np.where(load > before, speed * (before + pan) / (load + pan), speed)
        at, fast = _moved(depth, begun, load, time, parts)
        rate = np.sqrt(parts[0] / (load + pan))
        turn = np.minimum(rate * time, 1.2)
        wrong = READ_M * np.sqrt(1 + np.cos(turn) ** 2 + (READ_V / READ_M / rate * np.sin(turn)) ** 2)
        off = np.sqrt(READ_V**2 * (1 + np.cos(turn) ** 2) + (READ_M * rate * np.sin(turn)) ** 2)
        prior = [(values[1] - 0.9) / (0.3 if law != "any" else 3), (values[3] - 0.01) / 0.003]
        return np.concatenate([(at - last) / wrong, (fast - ended) / off, prior])

    low, high = [np.log(stiff / 6), 0.2 if law != "any" else -1.5, 0.05, 0.003], [np.log(stiff * 6), 1.5, 1.5, 0.02]
    return model, misfit, (low, high), [np.log(stiff), 0.8, 0.4, 0.01]


def _fitted(rows, law):
    """Chi-square and model of a law, each stretch begun from the reading before it."""
    model, misfit, ranges, start = _problem(rows, law)
    found = least_squares(misfit, start, bounds=ranges, max_nfev=25, x_scale=[0.1, 0.1, 0.1, 0.003])
    return 2 * found.cost, model(found.x)


def _weighed(rows, law):
    """A law, fitted within the ranges of its values alone."""
    model, misfit, ranges, start = _problem(rows, law)
    low, high = np.array(ranges)
    low[1], high[1] = 0.4, 1.4

    def bare(values):
        return misfit(values)[:-2]

    best = least_squares(bare, start, bounds=(low, high), max_nfev=60, x_scale=[0.1, 0.1, 0.1, 0.003]).x
    return member(bare, lambda values: _mass(model(values)), best, list(zip(low, high, strict=True)))


def _best(rows):
    """The law that fits best."""
    fits = [_fitted(rows, law) for law in LAWS]
    return fits[int(np.argmin([cost for cost, _ in fits]))][1]


def _more(model, depth, speed, total):
    """The largest load to add that keeps the pan slow and not too deep."""
    if depth < 0.06:  # the resistance is hardly known yet
        model = (*model[:3], min(model[3], 0.1 * model[0]), model[4])
    more = np.linspace(0, min(0.6 * depth + 0.005, 0.05) * model[0] / GRAVITY, 40)
    load = total + more
    speed = speed * (total + model[4]) / (load + model[4])
    risk = np.zeros(40)
    for _ in range(40):
        depth, speed = _moved(depth, speed, load, 0.02, model)
        risk = np.maximum(risk, np.maximum(depth / HIGH, np.abs(speed) / SLOW))
    return float(more[np.flatnonzero(risk < 1)[-1]]) if risk[0] < 1 else 0.0


def _deepest(load, model, depth=0.0, speed=0.0):
    """Deepest place of the first way down, or that of rest if there is none."""
    step = 0.005
    for _ in range(400):
        at, fast = _moved(depth, speed, load, step, model, step)
        if fast <= 0:
            part = speed / max(speed - fast, 1e-12)
            return depth + 0.5 * speed * part * step
        if at > 0.8:
            return at
        depth, speed = at, fast
    return depth


def _mass(model):
    """Mass of the block that comes to rest at the asked depth."""
    k = model[0]
    return float(
        brentq(
            lambda load: _deepest(load, model) - ASKED, 0.02 * k / GRAVITY, 4 * k / GRAVITY, xtol=1e-6 * k, rtol=1e-6
        )
    )


def fit(readings, structure):
    """The asked mass with one law."""
    return _mass(_fitted(_rows(readings), structure)[1])


def rivals(readings):
    """Each law, fitted."""
    rows = _rows(readings)
    return {law: _weighed(rows, law) for law in LAWS}


def solve(task):
    """Find the scale; then add loads that keep the pan slow, down to the deepest place that is safe."""
    log, spent, total, kg, turns = [], 0, 0.0, FIRST_KG, 1
    while not log or _rows(log)[-1][5] < SEEN:
        turns += 1
        calls = [*_load(spent, kg), *_look(LADDER_S)]
        spent, total, kg = spent + 1, total + kg, kg * 3.0
        log += zip(calls, (yield calls), strict=True)
    calls = _look(0.6)
    log += zip(calls, (yield calls), strict=True)
    while len(log) < 135 and turns < TURNS:
        turns += 1
        rows = _rows(log)
        model = _fitted(rows, "any")[1]
        depth, speed = rows[-1][5:]
        calls = []
        for span in SPANS_S:
            more = _more(model, depth, speed, total)
            if more > 0.01 * total:
                calls += _load(spent, more, depth)
                speed *= (total + model[4]) / (total + more + model[4])
                spent, total = spent + 1, total + more
            calls += _look(span)
            depth, speed = _moved(depth, speed, total, span, model)
        log += zip(calls, (yield calls), strict=True)
        if len(log) > 90 and rows[-1][5] > 0.97 * HIGH:
            break
    yield [answer(_mass(_best(_rows(log))))]


def batch(task):
    """A fixed ladder of loads, each with a look at the pan."""
    calls, kg, total = [], 0.02, 0.0
    for number in range(12):
        calls += [*_load(number, kg - total), *_look(0.5)]
        total, kg = kg, kg * 1.25
    rows = _rows(zip(calls, (yield calls), strict=True))
    try:
        value = _mass(_best(rows))
    except (ValueError, IndexError):  # too little was seen before the safety device acted
        value = 3.0
    yield [answer(value)]


def stage(task):
    """Ever heavier loads on the empty pan, until it comes deeper than the latch."""
    kg, number = 0.002, 0
    while number < 30:
        readings = yield [*_load(number, kg), *_look(0.3), call("delete_objects", object_id=f"a{number}")]
        if TOP - readings[-3]["position"][2] > DEEP:
            break
        kg, number = kg * 1.6, number + 1
    yield [answer(kg)]


def _drawn(knobs):
    return knobs["k"], knobs["curve"], knobs["cube"], knobs["oil"], knobs["mass"]


def structure(knobs):
    """Law of the push."""
    return knobs["law"]


def naive(knobs):
    """The push in proportion to the way; no resistance; the weight that the push bears at rest."""
    k, curve, cube, _, pan = _drawn(knobs)
    return {
        "no resistance": _mass((k, curve, cube, 0.0, pan)),
        "place of rest": k * ASKED * (1 + cube * ASKED**2) / (1 - curve * ASKED) / GRAVITY,
        "push of a spring": k * ASKED / 2 / GRAVITY,
    }


def theory(knobs):
    """The way down with the drawn values."""
    return _mass(_drawn(knobs))


def measure(engine, knobs):
    """The engine's pan with the mass and the weight of the block, without the safety device."""

    def deepest(load):
        world = engine.changed(
            {"body[object_1]/inertial.mass": knobs["mass"] + load, "body[trigger]/inertial.mass": 1e9}
        )
        world.push("object_1", force=np.array([0.0, 0.0, -load * GRAVITY]))
        before = 0.0
        while True:
            world.step(1)
            depth = TOP - world.pose("object_1").position[2]
            if depth < before or depth > 0.8:
                return float(max(before, depth))
            before = depth

    near = theory(knobs)
    low, high = 0.97 * near, 1.03 * near
    first, last = deepest(low), deepest(high)
    return float(low + (high - low) * (ASKED - first) / (last - first))
