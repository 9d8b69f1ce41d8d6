"""Scene 47: one meeting, looked at at the right moments, gives the potential at many distances; its form the rest."""

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

PUCK, OTHER, START_M = "object_2", "object_1", 4.0
LIMIT_N, ASKED_J, LEVEL_J = 0.5, 8.0, 1.5
"""Greatest force; energy asked for; energy of puck 1 far away at which the smallest distance is the size of a law."""
READ_M, READ_M_S = 3e-4, 3e-4
"""Standard deviations of the readings."""
FIRST_S, NEAR_M, NEARER, LOOKS, SLOWEST = 0.8, 1.1, 0.12, 3, 0.25
"""Length of the first push; where the looks become frequent, their spacing over the distance, and their number in an
iteration; share of the greatest speed that counts as slow."""
CALLS, TIME_S, LAST_S, ROOM_M = 128, 10.5, 1.0, 4.6
"""Limits of calls and time; length of the last look; how far puck 1 may go, with the speed that it has, before it."""


def _power(d, size, shape):
    return (size / d) ** shape


def _decay(d, size, shape):
    return np.exp(np.minimum((size - d) / (size * shape), 60))


def _range(d, size, shape):
    return (np.maximum(1 + shape - d / size, 0) / shape) ** 2


FORMS = {"power": (_power, (1.5, 3.0)), "decay": (_decay, (0.25, 0.5)), "range": (_range, (0.3, 0.6))}
"""Structure → potential over its value at a size, and starts of its shape."""


def _rows(exchanges):
    """Time, places and speeds of puck 2 and puck 1, and impulse and work of the pushes up to each reading."""
    push, impulse, work, rows, before, now = 0.0, 0.0, 0.0, [], (0.0, -START_M), {}
    for asked, reading in exchanges:
        own = asked.arguments.get("object_id") == PUCK
        if asked.tool == "apply_force":
            push = asked.arguments["force_vector"][0]
        elif asked.tool in ("get_position", "get_velocity"):
            kind = asked.tool[4:]
            now[kind, own] = reading[kind][0]
            if len(now) == 4:
                time, place = reading["sim_time"], now["position", True]
                impulse, work = impulse + push * (time - before[0]), work + push * (place - before[1])
                speeds = now["velocity", True], now["velocity", False]
                rows.append([time, place, now["position", False], *speeds, impulse, work])
                before, now = (time, place), {}
    return np.array(rows)


def _misfits(p, form, rows):
    """Misfits of momentum and energy; p: masses and size (their logarithms), and shape."""
    _, own, its, speed, other, impulse, work = rows.T
    ours, theirs, size = np.exp(p[:3])
    d = its - own
    share = LEVEL_J * theirs / (ours + theirs)
    slope = share * (form(d + 1e-4, size, p[3]) - form(d - 1e-4, size, p[3])) / 2e-4
    potential = share * (form(d, size, p[3]) - form(START_M, size, p[3]))
    moved = (ours * speed + theirs * other - impulse) / (READ_M_S * np.hypot(ours, theirs))
    energy = ours * speed**2 / 2 + theirs * other**2 / 2 + potential - work
    rough = np.sqrt(
        (ours * speed * READ_M_S) ** 2
        + (theirs * other * READ_M_S) ** 2
        + 2 * (slope * READ_M) ** 2
        + (0.5 * READ_M) ** 2
    )
    return np.clip(np.concatenate([moved, energy / rough]), -1e4, 1e4)


def _fitted(rows, name):
    """Cost and constants of the best potential of a structure."""
    form, shapes = FORMS[name]
    near = float(np.min(rows[:, 2] - rows[:, 1]))
    table, impulse = rows[:, 3:5], rows[:, 5]
    masses = np.log(np.clip(np.linalg.lstsq(table, impulse, rcond=None)[0], 0.1, 50))
    fits = []
    for shape in shapes:
        low = [*(masses - 2), np.log(near) - 2, 0.05]
        high = [*(masses + 2), np.log(near) + 3, 12.0]
        start = [*masses, np.log(1.2 * near), shape]
        for loss in ("soft_l1", "linear"):
            found = least_squares(
                _misfits, start, bounds=(low, high), x_scale=0.1, loss=loss, args=(form, rows), max_nfev=40
            )
            start = found.x
        fits.append((float(found.cost), found.x))
    return min(fits, key=lambda got: got[0])


def _nearest(form, size, shape, level=LEVEL_J):
    """Where the potential equals an energy of puck 1 far away; both are reduced by the same share of the masses."""
    if level * form(1e-3, size, shape) < ASKED_J:
        return 1e-3
    return float(brentq(lambda d: level * form(d, size, shape) - ASKED_J, 1e-3, 50.0))


def fit(readings, structure):
    """The distance by the potential of a structure."""
    p = _fitted(_rows(readings), structure)[1]
    return _nearest(FORMS[structure][0], np.exp(p[2]), p[3])


def _member(rows, name):
    """A structure, fitted; the ranges of masses and size lie about the best ones."""
    best = _fitted(rows, name)[1]
    ranges = [(value - 1.5, value + 1.5) for value in best[:3]]
    return member(
        lambda p: _misfits(p, FORMS[name][0], rows),
        lambda p: _nearest(FORMS[name][0], np.exp(p[2]), p[3]),
        best,
        [*ranges, (0.05, 12.0)],
    )


def rivals(readings):
    """Every form of the potential, fitted."""
    rows = _rows(readings)
    return {name: _member(rows, name) for name in FORMS}


def _best(exchanges):
    rows = _rows(exchanges)
    name = min(FORMS, key=lambda form: _fitted(rows, form)[0])
    return fit(exchanges, name)


def _push(force):
    return call("apply_force", object_id=PUCK, force_vector=[force, 0.0, 0.0])


def _look(seconds):
    seconds = 0.005 * max(round(seconds / 0.005), 1)
    return [
        call("step", duration=round(seconds, 3)),
        *(call(tool, object_id=puck) for tool in ("get_position", "get_velocity") for puck in (PUCK, OTHER)),
    ]


def solve(task):
    """Push a little to know the mass, come near in one go, then look the more often the nearer the pucks are."""
    yield [call("find_objects")]
    exchanges = []

    def state(calls, readings):
        exchanges.extend(zip(calls, readings, strict=True))
        time, own, its, speed, its_speed, *_ = _rows(exchanges)[-1]
        return time, its - own, speed - its_speed, (ROOM_M - its) / max(its_speed, 0.1)

    calls = [_push(LIMIT_N), *_look(FIRST_S)]
    time, distance, speed, _ = state(calls, (yield calls))
    gain = speed / time
    calls = _look((np.sqrt(speed**2 + 2 * gain * (distance - NEAR_M)) - speed) / gain)
    time, distance, speed, _ = state(calls, (yield calls))
    fastest, nearest = speed, distance
    while len(exchanges) + 5 * (LOOKS + 1) < CALLS and not (speed < 0 and distance > 2.0 * nearest):
        pause = NEARER * distance / max(abs(speed), SLOWEST * fastest)
        calls = _look(pause) * LOOKS
        time, distance, speed, room = state(calls, (yield calls))
        fastest, nearest = max(fastest, speed), min(nearest, distance)
    calls = _look(min(max(TIME_S - time, LAST_S), room))
    state(calls, (yield calls))
    yield [answer(_best(exchanges))]


def _shape(knobs):
    return {"power": knobs["n"], "decay": knobs["share"], "range": knobs["reach"] - 1}[knobs["kind"]]


def theory(knobs):
    """Where the drawn potential equals the energy in the frame of the centre of mass."""
    return _nearest(FORMS[knobs["kind"]][0], knobs["size"], _shape(knobs))


def measure(engine, knobs):
    """The meeting in the engine, without nets, from so far away that the rest of the potential is known."""
    far, form = 8.0, FORMS[knobs["kind"]][0]
    free = engine.changed({"body[nets].pos": (1e6, 0.0, 0.0)})
    left = ASKED_J - LEVEL_J * float(form(far, knobs["size"], _shape(knobs)))
    speed = np.sqrt(2 * left / knobs["m2"])
    free.place(PUCK, np.array([-far, 0.0, 0.0]), {})
    free.set_velocity(PUCK, np.array([speed, 0.0, 0.0]))
    distances = []
    for _ in range(free.whole_steps(1.5 * far / speed)):
        free.step(1)
        distances.append(float(free.pose(OTHER).position[0] - free.pose(PUCK).position[0]))
    low = min(max(int(np.argmin(distances)), 1), len(distances) - 2)
    before, least, after = distances[low - 1 : low + 2]
    return least - (before - after) ** 2 / (8 * (before + after - 2 * least))


def naive(knobs):
    """Charges that push each other apart; all of the energy in the meeting, puck 1 taken for fixed."""
    form, shape = FORMS[knobs["kind"]][0], _shape(knobs)
    charges = knobs["size"] * LEVEL_J / ASKED_J
    fixed = _nearest(form, knobs["size"], shape, LEVEL_J * knobs["ratio"] / (1 + knobs["ratio"]))
    return {"like charges": charges, "puck 1 fixed": fixed}


def stage(task):
    """Push as long as the rail allows, and answer with the nearest place seen."""
    yield [call("find_objects")]
    calls = [_push(LIMIT_N), *(_look(0.5) * 20)]
    readings = yield calls
    rows = _rows(zip(calls, readings, strict=True))
    yield [answer(float(np.min(rows[:, 2] - rows[:, 1])))]


def batch(task):
    """A steady push, with looks at even intervals while they may meet."""
    calls = [call("find_objects"), _push(LIMIT_N), *_look(2.4), *(_look(0.5) * 10)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]
