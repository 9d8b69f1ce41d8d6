"""Scene 97: drag and line from towing in still water, the stream from slow passages, a balance for the prediction."""

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

CART, START = "object_1", 0.4
RAIL = 1.0
"""Resistance of the tug's rail, N·s/m."""
LIMIT_N, NAIL, FARTHEST = 6.0, 12.0, 9.3
FASTER = 2.5
TOWS = ((-0.5, 11.0, 1.5), (-1.5, 5.0, 1.0), (-3.5, 3.5, 0.5), (-6.0, 2.5, 0.4))
"""Force, time to settle and pause between two looks in still water."""
CREEP, STRETCH, LOOKS = 0.35, 1.1, 2
CALLS, TIME_S = 150, 90.0
READ_M, READ_V = 0.003, 0.002
PROFILES = ("even", "rising", "step")


def _look(duration, tug):
    return [
        call("step", duration=round(duration, 2)),
        call("get_position", object_id=CART),
        call("get_position", object_id=tug),
        call("get_velocity", object_id=CART),
        call("get_velocity", object_id=tug),
    ]


def _pull(force, tug):
    return call("apply_force", object_id=tug, force_vector=[round(force, 3), 0, 0])


def _rows(exchanges):
    """Rows of time, place and speed of the cart, length of the line, speed of the tug, force."""
    rows, force, time, looked = [], 0.0, 0.0, {}
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            time, looked = time + asked.arguments["duration"], {}
        elif asked.tool in ("get_position", "get_velocity"):
            kind = asked.tool[4:]
            looked[kind, asked.arguments["object_id"] == CART] = reading[kind][0]
            if len(looked) == 4:
                x, tug = looked["position", True], looked["position", False]
                rows.append((time, x, looked["velocity", True], tug - x, looked["velocity", False], force))
    return np.array(rows)


def _steady(rows):
    """Rows in which cart and tug go equally fast with the line taut: pull of the line, its length, place and speed."""
    _, x, speed, apart, tug, force = rows.T
    kept = np.abs(speed - tug) < 0.004 + 0.04 * np.abs(speed)
    pull = force - RAIL * tug
    kept &= (np.abs(pull) > 0.1) & (apart * pull > 0)
    return pull[kept], apart[kept], x[kept], speed[kept]


def _water(rows):
    """Power and size of the drag from steady towing in still water; chi² of either power decides."""
    pull, _, x, speed = _steady(rows)
    still = (x < 0.5) & (np.abs(speed) > 0.02)
    logs, force = np.log(np.abs(speed[still])), np.log(np.abs(pull[still]))
    offs = {power: force - (1 + power) * logs for power in (0, 1)}
    return {power: (float(np.var(off)), float(np.exp(np.mean(off)))) for power, off in offs.items()}


def _stream(rows, power, size):
    """Places and speeds of the stream there: drag of the speed through the water is the pull of the line."""
    pull, _, x, speed = _steady(rows)
    inside = (x > 1.8) & (pull > 0)
    return x[inside], (pull[inside] / size) ** (1 / (1 + power)) - speed[inside]


def _profile(kind, x, u):
    """Squares of deviations, and the stream as a function of the place."""
    if kind == "rising":
        steps = [None]
    elif kind == "step":
        order = np.sort(x)
        steps = [place for place in (order[1:] + order[:-1]) / 2 if order[1] < place < order[-2]]
    else:
        steps = [None]
    best = None
    for place in steps:
        columns = [np.ones(len(x))]
        if kind == "rising":
            columns.append(x)
        elif place is not None:
            columns.append((x > place).astype(float))
        basis = np.column_stack(columns)
        parts = np.linalg.lstsq(basis, u, rcond=None)[0]
        rest = float(np.sum(np.square(basis @ parts - u)))
        if best is None or rest < best[0]:
            best = (rest, parts, place)
    if best is None:
        return _profile("even", x, u)
    rest, parts, place = best
    if kind == "even":
        return rest, lambda _at: parts[0]
    if kind == "rising":
        return rest, lambda at: parts[0] + parts[1] * at
    return rest, lambda at: parts[0] + parts[1] * (at > place)


def _line(rows):
    """Length of the line as a function of its pull: two straight pieces, by least squares."""
    pull, apart, _, _ = _steady(rows)
    pull, apart = np.abs(pull), np.abs(apart)

    def length(values, at):
        free, soft, softer, bend = values
        return free + soft * np.minimum(at, bend) + softer * np.maximum(at - bend, 0.0)

    fits = [
        least_squares(
            lambda values: (length(values, pull) - apart) / READ_M,
            [apart.min() * 0.8, 0.2, soft, bend],
            bounds=([0.1, 0.02, 0.01, 0.3], [4.0, 1.0, 3.0, 2.2]),
        )
        for bend in (0.7, 1.0, 1.3)
        for soft in (0.07, 0.5)
    ]
    best = min(fits, key=lambda got: got.cost).x
    return lambda at: float(length(best, at))


def _predict(length, stream, power, size):
    """Length of the line where it balances the drag of the faster stream."""

    def surplus(reach):
        return reach - length(size * (FASTER * stream(NAIL - reach)) ** (1 + power))

    return float(brentq(surplus, 0.1, NAIL - 1.0))


def _answer(rows, label=None):
    powers = _water(rows)
    power = min(powers, key=lambda each: powers[each][0]) if label is None else int(label.split()[1])
    size = powers[power][1]
    x, u = _stream(rows, power, size)
    if label is None:
        rests = [_profile(kind, x, u)[0] for kind in PROFILES]
        noise = max(min(rests) / len(x), 1e-5)
        costs = [rest / noise + 8 * number for rest, number in zip(rests, (0, 1, 1.5), strict=True)]
        kind = PROFILES[int(np.argmin(costs))]
    else:
        kind = label.split()[0]
    return _predict(_line(rows), _profile(kind, x, u)[1], power, size)


def solve(task):
    """Still water at four forces; back, with the time that the drag needs; then slowly against the stream."""
    reading = (yield [call("find_objects")])[0]
    tug = reading["revealed"][0]["object_id"]
    history = []

    def made(calls, readings):
        history.extend(zip(calls, readings, strict=True))
        return _rows(history)

    calls = [
        asked for force, settle, pause in TOWS for asked in (_pull(force, tug), *_look(settle, tug), *_look(pause, tug))
    ]
    rows = made(calls, (yield calls))
    powers = _water(rows)
    power = min(powers, key=lambda each: powers[each][0])
    size = powers[power][1]

    def tow(speed, stream):
        return min(size * (speed + stream) ** (1 + power) + RAIL * speed, LIMIT_N)

    # The tug turns round: it goes through the slack before it tows again.
    fast = brentq(lambda v: size * v ** (1 + power) + RAIL * v - 4.0, 0.0, 9.0)
    slack = 2 * abs(rows[-1, 3]) / 3.0
    calls = [_pull(4.0, tug), *_look(slack + max(0.75 * (0.3 - rows[-1, 1]) / fast, 0.5), tug)]
    rows = made(calls, (yield calls))
    stream, stuck = 0.0, 0
    while rows[-1, 1] < FARTHEST and stuck < 3:
        left = TIME_S - rows[-1, 0]
        x, speed = rows[-1, 1:3]
        if x < 0.6:
            calls = [_pull(4.0, tug), *_look(max(0.95 * (0.9 - x) / max(speed, 0.15), 0.4), tug)]
        else:
            force = tow(CREEP, stream)
            calls = [
                _pull(force, tug),
                *(asked for _ in range(LOOKS) for asked in _look(STRETCH / LOOKS / CREEP, tug)),
            ]
        if (
            len(history) + 1 + len(calls) > CALLS
            or sum(c.arguments["duration"] for c in calls if c.tool == "step") > left
        ):
            break
        rows = made(calls, (yield calls))
        _, x, speed, _, tug_speed, force = rows[-1]
        if x > 0.9 and force - RAIL * tug_speed > 0.05:
            stream = max(((force - RAIL * tug_speed) / size) ** (1 / (1 + power)) - speed, 0.0)
            stream += 0.15 * (speed < 0.05)
        stuck = stuck + 1 if force >= LIMIT_N - 0.01 and speed < 0.03 else 0
    yield [answer(_answer(rows))]


def structure(knobs):
    """How the stream depends on the place, and the power of the drag."""
    return f"{knobs['profile']} {knobs['power']}"


def fit(readings, structure):
    """The answer by this profile and power, fitted to the readings."""
    return _answer(_rows(readings), structure)


def batch(task):
    """Towing laid down beforehand: still water at three forces, then against the stream at growing ones."""
    tug = "object_2"
    plan = [(-0.5, 10, 1), (-2.0, 4, 1), (-5.0, 3, 1), (4.0, 10, 1), (1.5, 6, 1), (2.5, 3, 2), (4.0, 2, 1)]
    calls = [call("find_objects")]
    for force, duration, looks in plan:
        calls += [_pull(force, tug), *(asked for _ in range(looks) for asked in _look(duration, tug))]
    rows = _rows(zip(calls, (yield calls), strict=True))
    try:
        value = _answer(rows)
    except (ValueError, ArithmeticError, IndexError, np.linalg.LinAlgError):
        value = float(np.max(np.abs(rows[:, 3])))
    yield [answer(value)]


def stage(task):
    """Hold the tug in the stream with the greatest force, and read how long the line is."""
    tug = "object_2"
    readings = yield [call("find_objects"), _pull(LIMIT_N, tug), call("step", duration=60.0), *_look(1.0, tug)]
    yield [answer(abs(readings[-3]["position"][0] - readings[-4]["position"][0]))]


def _known(knobs):
    """Length at a pull, stream at a place, power and size of the drag, as drawn."""

    def length(at):
        return knobs["free"] + min(at, knobs["bend"]) / knobs["k1"] + max(at - knobs["bend"], 0.0) / knobs["k2"]

    def stream(at):
        beyond = (1 + np.tanh((at - knobs["place"]) / 0.05)) / 2
        rise = 1 + knobs["growth"] * max(0.0, at - knobs["edge"]) + knobs["jump"] * beyond
        return knobs["u0"] * rise * (1 + np.tanh((at - knobs["edge"]) / 0.05)) / 2

    return length, stream, knobs["power"], knobs["c"]


def theory(knobs):
    """Balance of line and drag in the faster stream."""
    return _predict(*_known(knobs))


def naive(knobs):
    """The first stiffness carried on; the other power of the speed; length in proportion to the force."""
    length, stream, power, size = _known(knobs)
    first, full = knobs["free"], length(LIMIT_N)

    def carried(at):
        return first + at / knobs["k1"]

    force = size * stream(2.0) ** (1 + power)
    return {
        "one stiffness": _predict(carried, stream, power, size),
        "line without slack, force at the edge in proportion": FASTER * force / LIMIT_N * full,
        "drag not changed": _predict(length, lambda at: stream(at) / FASTER, power, size),
    }


def measure(engine, knobs):
    """The nailed tug and the faster stream in the engine, let go near the balance."""
    near = NAIL - theory(knobs) - 0.3
    world = engine.changed(
        {
            "body[object_1].pos": (near, 0.0, 1.0),
            "body[object_2].pos": (NAIL, 0.5, 1.0),
            "body[object_2]/inertial.mass": 1e9,
            "body[weir].pos": (0.0, 1.0, 1.0),
        }
    )
    world.step(world.whole_steps(60.0))
    return float(world.pose("object_2").position[0] - world.pose(CART).position[0])
