"""Scene 76: balance impulses over many intervals; what the box passes on, against the slip, tells what is in it."""

from itertools import product

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

FAR_N, BRAKE_N = 40.0, 1.0
LOW, HIGH = np.array([0.1, 0.1, 0.1, 0.01, 0.0, 0.0, 0.01]), np.array([5.0, 20, 20, 20, 6, 20, 20])
"""Bounds of the gear ratio, m1, m2, c1, f1, r2 and the constant of the coupling."""
FORCE, ROOM = 10.0, 15.0
LEVELS = (10, 3, 10, 10, 10, 0, 10, 2, 10, 10, 0, 10, 10)
TIMES = (4.0, 3.0, 2.4, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, 0.4, 0.3, 0.2)
KINDS, LAWS = ("rigid", "clutch", "oil"), ("dry", "linear", "square")
SIGMA = 2e-3
"""Standard deviation of a difference of two rounded readings [m, m/s]."""


def _state():
    return [
        call(tool, object_id=body) for tool in ("get_position", "get_velocity") for body in ("object_1", "object_2")
    ]


def _push(force, duration):
    return [
        call("apply_force", object_id="object_1", force_vector=[force, 0, 0]),
        call("step", duration=duration),
        *_state(),
    ]


def _states(exchanges):
    """Rows of time, places and speeds of both carts, and the force since the row before, from the start on."""
    rows, force, found = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)], 0.0, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool in ("get_position", "get_velocity"):
            found.append(reading[asked.tool.removeprefix("get_")][0])
            if len(found) == 4:
                rows.append((reading["sim_time"], *found, force))
                found = []
    return np.array(rows)


def _signs(first, last, duration):
    """Integral of the sign of a speed that changes evenly."""
    return duration * (abs(last) - abs(first)) / np.where(abs(last - first) > 1e-9, last - first, 1.0) * (
        first * last < 0
    ) + duration * np.sign(first + last) * (first * last >= 0)


def _windows(rows):
    """Impulse, changes of speed, ways and integrals of sign(v) and v2|v2| over every interval in which things move."""
    (t, x1, x2, v1, v2, _), (u, y1, y2, w1, w2, force) = rows[:-1].T, rows[1:].T
    dt, way2 = u - t, y2 - x2
    middle = (6 * way2 / dt - v2 - w2) / 4
    square = dt * (v2 * abs(v2) + 4 * middle * abs(middle) + w2 * abs(w2)) / 6
    win = {"F": force * dt, "dt": dt, "d1": w1 - v1, "d2": w2 - v2, "x1": y1 - x1, "x2": way2}
    win |= {"s1": _signs(v1, w1, dt), "s2": _signs(v2, w2, dt), "q2": square, "v1": v1, "w1": w1, "v2": v2, "w2": w2}
    win["rests"] = abs(way2) < 3 * SIGMA
    stops = np.minimum(abs(w1), abs(w2)) < 2 * SIGMA
    win["turns"] = 0.15 * ((v1 * w1 < 0) | (v2 * w2 < 0)) + 0.5 * stops
    moving = (abs(v1) + abs(w1) > 10 * SIGMA) | (abs(y1 - x1) > 5 * SIGMA)
    return {name: column[moving] for name, column in win.items()}


def _misfit(p, kind, law, win):
    """Misfits of the balances, divided by their uncertainties; p: see LOW."""
    n, m1, m2, c1, f1, r2, power = p
    loss = r2 * {"dry": win["s2"], "linear": win["x2"], "square": win["q2"]}[law]
    rough = 0.002 * abs(win["F"]) + win["turns"] * win["dt"] * (f1 + n * r2 * (law != "linear"))
    unsure = (win["rests"] & (law == "dry")) * 1e3
    taken = m2 * win["d2"] + loss
    both = m1 * win["d1"] + c1 * win["x1"] + f1 * win["s1"] + n * taken - win["F"]
    found = [both / np.hypot(SIGMA * np.hypot(m1, n * m2), rough) / (1 + unsure)]
    slip = n * win["v1"] - win["v2"], n * win["w1"] - win["w2"]
    way = n * win["x1"] - win["x2"]
    tolerance = 8 * SIGMA + 0.003 * (abs(win["v1"]) + abs(win["w1"]))
    stuck = (abs(slip[0]) < tolerance) & (abs(slip[1]) < tolerance) & (abs(way) < 8 * SIGMA)
    error = np.hypot(SIGMA * m2, 0.002 * abs(taken) + win["turns"] * win["dt"] * r2 * (law != "linear"))
    if kind == "oil":
        error = np.hypot(error, 0.0004 * power * abs(slip[1] - slip[0]))
        found.append((taken - power * way) / np.hypot(error, SIGMA * power) / (1 + unsure))
    elif kind == "rigid":
        found.append(way / SIGMA / 4)
    else:
        slides = power * _signs(slip[0], slip[1], win["dt"])
        mixed = (slip[0] * slip[1] < 0) | (abs(slip[0]) < tolerance) | (abs(slip[1]) < tolerance)
        error = np.hypot(error, mixed * 0.5 * power * win["dt"])
        found.append(np.where(stuck, way / SIGMA / 4, (taken - slides) / error / (1 + unsure)))
    return np.clip(np.concatenate(found), -300, 300)


def _robust(table, right, size):
    """Least squares, with less weight on what fits badly."""
    weights = 1 / size
    for _ in range(6):
        found, *_ = np.linalg.lstsq(table * weights[:, None], right * weights, rcond=1e-10)
        weights = 1 / size / np.sqrt(1 + ((table @ found - right) / size / 3) ** 2)
    return found


def _slides(n, win):
    """Intervals in which a clutch slips all the time, in one sense."""
    first, last = n * win["v1"] - win["v2"], n * win["w1"] - win["w2"]
    return (first * last > 0) & (np.minimum(abs(first), abs(last)) > 12 * SIGMA + 0.004 * abs(win["v1"] + win["w1"]))


def _start(kind, law, win, n):
    """Constants by steps: how object_2 answers to the slip, then the balance of both."""
    basis = {"dry": win["s2"], "linear": win["x2"], "square": win["q2"]}[law]
    rough = win["turns"] * win["dt"] * 0.3
    share, power, moving = 0.3, 2.0, ~win["rests"]
    if kind == "oil":
        table = np.column_stack([-basis, win["x1"], -win["x2"]])[moving]
        share, pulled, power = _robust(table, win["d2"][moving], np.hypot(SIGMA, rough[moving]))
        n = float(np.clip(pulled / power, 0.2, 4.5))
    elif kind == "clutch":
        slides = moving & _slides(n, win)
        if slides.sum() > 2:
            table = np.column_stack([-basis, np.sign(n * win["v1"] - win["v2"]) * win["dt"]])[slides]
            share, power = _robust(table, win["d2"][slides], np.hypot(SIGMA, rough[slides]))
    table = np.column_stack([win["d1"], n * (win["d2"] + share * basis), win["x1"], win["s1"]])
    m1, m2, c1, f1 = _robust(table, win["F"], 2 * np.hypot(SIGMA, rough + 0.0005 * abs(win["F"])))
    start = np.clip([n, m1, m2, c1, f1, share * m2, power * m2], LOW + 1e-6, HIGH - 1e-6)
    return float(np.sum(np.minimum(_misfit(start, kind, law, win) ** 2, 400))), start


def _fit(kind, law, win):
    """Misfit and constants of a structure."""
    seen = np.clip(win["w2"] / np.where(abs(win["w1"]) > 12 * SIGMA, win["w1"], np.inf), 0.0, 4.0)
    ratios = [float(np.median(seen))]
    if kind == "clutch":
        ratios = [n for n in [*np.geomspace(0.35, 3.0, 24), *seen[seen > 0.25]] if _slides(n, win).any()]
    starts = sorted((_start(kind, law, win, n) for n in ratios), key=lambda entry: entry[0])[:3]
    best = (1e6, np.clip(np.ones(7), LOW, HIGH))
    for _, start in starts:
        low, high = LOW.copy(), HIGH.copy()
        if kind == "clutch":
            low[0], high[0] = 0.9 * start[0], 1.1 * start[0]
        found = least_squares(
            _misfit,
            start,
            bounds=(low, high),
            x_scale=np.maximum(start, 0.1),
            loss="soft_l1",
            args=(kind, law, win),
            max_nfev=60,
        )
        if found.cost < best[0]:
            best = (float(found.cost), found.x)
    return best


def _speed(force, r2, law):
    """Steady speed of object_2 against its own resistance and the brake."""
    if law == "dry":
        return 0.0 if force <= BRAKE_N + r2 else np.inf
    rest = max(force - BRAKE_N, 0.0) / max(r2, 1e-6)
    return rest if law == "linear" else np.sqrt(rest)


def _resisted(v, r2, law):
    return BRAKE_N + r2 * {"dry": 1.0, "linear": v, "square": v * v}[law]


def _steady(kind, law, n, c1, f1, r2, power):
    """Speeds of both carts in the end."""
    spare = FAR_N - f1
    if kind == "oil":

        def excess(force):
            v1 = (spare - n * force) / c1
            return n * v1 - force / power - min(_speed(force, r2, law), 1e6)

        if excess(spare / n) > 0:
            return [float(spare / c1), 0.0]
        if law == "dry" and excess(BRAKE_N + r2 - 1e-12) > 0:
            force = BRAKE_N + r2
            return [float((spare - n * force) / c1), float(n * (spare - n * force) / c1 - force / power)]
        force = brentq(excess, 0.0, spare / n)
        return [float((spare - n * force) / c1), float(_speed(force, r2, law))]
    free = spare - n * BRAKE_N
    tied = (
        brentq(lambda v: spare - c1 * v - n * _resisted(n * v, r2, law), 0.0, max(spare, 1.0) / c1)
        if free > n * r2 * (law == "dry")
        else 0.0
    )
    if kind == "rigid" or _resisted(n * tied, r2, law) <= power:
        return [float(tied), float(n * tied)]
    return [float((spare - n * power) / c1), float(_speed(power, r2, law))]


def _predict(kind, law, win):
    _, (n, _, _, c1, f1, r2, power) = _fit(kind, law, win)
    return _steady(kind, law, n, c1, f1, r2, power)


def fit(readings, structure):
    """Predict with the coupling and the resistance of this structure."""
    kind, law = structure.split(", ")
    return _predict(kind, law, _windows(_states(readings)))


def _safe(row, force, duration, gains):
    """Whether both carts stay clear of the nets in an interval and can be stopped after it."""
    _, x1, x2, v1, v2, _ = row
    for x, v, gain in ((x1, v1, gains[0]), (x2, v2, gains[1])):
        for push in (force * gain, 0.6 * force * gain):
            end, speed = x + v * duration + push * duration**2 / 2, v + push * duration
            stop = speed * abs(speed) / (2 * 8 * gain)
            if abs(end) > ROOM or abs(end + stop) > ROOM:
                return False
    return True


def _choose(level, row, gains, sign):
    """Force and time of an interval: go on in this direction as long as the nets are far, else turn round."""
    tries = [(level * sign, duration) for duration in TIMES[:-3]] + [(-10.0 * sign, duration) for duration in TIMES]
    for force, duration in tries:
        if _safe(row, force, duration, gains):
            return float(force), duration
    return -10.0 * float(np.sign(row[3]) or 1), TIMES[-2]


def _gains(rows):
    """Greatest change of speed per impulse of both carts."""
    change = abs(np.diff(rows[:, 3:5], axis=0)) / np.maximum(abs(rows[1:, 5:]) * np.diff(rows[:, :1], axis=0), 1e-9)
    return np.maximum(np.max(change[abs(rows[1:, 5]) > 2], axis=0), 0.05)


def solve(task):
    """Push by turns, choosing force and duration from the present motion; then compare all structures."""
    exchanges, gains, sign = [], np.array([1.5, 1.5]), 1.0
    for level in LEVELS:
        force, duration = _choose(level, _states(exchanges)[-1], gains, sign)
        sign = float(np.sign(force)) or sign
        plan = [*_push(force, duration / 2), call("step", duration=duration / 2), *_state()]
        readings = yield plan
        exchanges += list(zip(plan, readings, strict=True))
        gains = _gains(_states(exchanges))
    win = _windows(_states(exchanges))
    _, kind, law = min(
        (_fit(kind, law, win)[0] + 40 * (kind != "rigid"), kind, law) for kind, law in product(KINDS, LAWS)
    )
    yield [answer(_predict(kind, law, win))]


def batch(task):
    """Twelve pulses fixed in advance, read at their ends."""
    plan = []
    for force, duration in (
        (3, 0.4),
        (10, 0.5),
        (-10, 0.9),
        (-10, 0.5),
        (10, 0.9),
        (10, 0.4),
        (-5, 0.6),
        (10, 0.6),
        (-10, 1.0),
        (10, 0.5),
    ):
        plan += _push(force, duration)
    readings = yield plan
    win = _windows(_states(list(zip(plan, readings, strict=True))))
    _, kind, law = min(
        (_fit(kind, law, win)[0] + 40 * (kind != "rigid"), kind, law) for kind, law in product(KINDS, LAWS)
    )
    yield [answer(_predict(kind, law, win))]


def stage(task):
    """Push with 40 N; it is refused, and 10 N bring the carts to other speeds."""
    readings = yield [*_push(FAR_N, 0.5), *_push(FORCE, 1.5)]
    yield [answer([reading["velocity"][0] for reading in readings if "velocity" in reading][-2:])]


def structure(knobs):
    """What joins the carts, and how object_2 is braked."""
    return f"{knobs['kind']}, {knobs['law']}"


def _power(knobs):
    return {"clutch": knobs["grip"], "oil": knobs["oil"], "rigid": 1e4}[knobs["kind"]]


def theory(knobs):
    """The steady state with the brake."""
    return _steady(knobs["kind"], knobs["law"], knobs["n"], knobs["c1"], knobs["f1"], knobs["r2"], _power(knobs))


def naive(knobs):
    """The resistance of object_1 alone, and the gear without slip."""
    top = FAR_N / knobs["c1"]
    return {"object_2 ignored": [top, knobs["n"] * top]}


def measure(engine, knobs):
    """Push with 40 N against the brake, from near the steady speeds on, with the nets a million metres away."""
    changed = engine.changed({"joint[x2].frictionloss": knobs["f2"] + BRAKE_N, "body[nets].pos": (1e6, 0.0, 0.0)})
    for body, speed in zip(("object_1", "object_2"), theory(knobs), strict=True):
        changed.set_velocity(body, np.array([0.9 * speed, 0.0, 0.0]))
    changed.push("object_1", force=np.array([FAR_N, 0.0, 0.0]))
    changed.step(changed.whole_steps(60.0))
    return [float(changed.twist(body).linear[0]) for body in ("object_1", "object_2")]
