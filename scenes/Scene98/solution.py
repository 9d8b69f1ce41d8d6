"""Scene 98: push both carriages in many ways; what passes between them, against the slip, tells what joins them."""

from itertools import product

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

FAR_N = (60.0, 12.0)
LOW, HIGH = np.array([0.1, 0.1, 0.1, 0.01, 0.0, 0.0, 0.0, 0.01]), np.array([5.0, 20, 20, 20, 6, 8, 20, 20])
"""Bounds of the gear ratio, m1, m2, c1, f1, r2 and the constant of the coupling."""
FORCE, ROOM = 10.0, 9.3
PAIRS = ((10, 0), (0, 10), (10, -10), (-3, 8), (10, 10), (10, 0), (0, 10), (0, 0), (10, -7), (10, 6), (4, 0), (-7, 10))
TIMES = (4.0, 3.0, 2.4, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, 0.4, 0.3, 0.2)
KINDS, LAWS = ("rigid", "clutch", "fluid"), ("linear", "square")
SIGMA = 8e-4
"""Standard deviation of a difference of two rounded readings [m, m/s]."""


def _state():
    return [
        call(tool, object_id=body) for tool in ("get_position", "get_velocity") for body in ("object_1", "object_2")
    ]


def _push(forces, duration):
    pushes = [
        call("apply_force", object_id=body, force_vector=[force, 0, 0])
        for body, force in zip(("object_1", "object_2"), forces, strict=True)
    ]
    return [*pushes, call("step", duration=duration), *_state()]


def _states(exchanges):
    """Rows of time, places and speeds of both, and the forces since the row before, from the start on."""
    rows, forces, found = [(0.0,) * 7], {"object_1": 0.0, "object_2": 0.0}, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            forces[asked.arguments["object_id"]] = asked.arguments["force_vector"][0]
        elif asked.tool in ("get_position", "get_velocity"):
            found.append(reading[asked.tool.removeprefix("get_")][0])
            if len(found) == 4:
                rows.append((reading["sim_time"], *found, *forces.values()))
                found = []
    return np.array(rows)


def _signs(first, last, duration):
    """Integral of the sign of a speed that changes evenly."""
    return duration * (abs(last) - abs(first)) / np.where(abs(last - first) > 1e-9, last - first, 1.0) * (
        first * last < 0
    ) + duration * np.sign(first + last) * (first * last >= 0)


def _windows(rows):
    """Impulse, changes of speed, ways and integrals of sign(v) and v2|v2| over every interval in which things move."""
    (t, x1, x2, v1, v2, *_), (u, y1, y2, w1, w2, force, other) = rows[:-1].T, rows[1:].T
    dt, way2 = u - t, y2 - x2
    middle = (6 * way2 / dt - v2 - w2) / 4
    square = dt * (v2 * abs(v2) + 4 * middle * abs(middle) + w2 * abs(w2)) / 6
    win = {"F": force * dt, "G": other * dt, "dt": dt, "d1": w1 - v1, "d2": w2 - v2, "x1": y1 - x1, "x2": way2}
    win |= {"s1": _signs(v1, w1, dt), "s2": _signs(v2, w2, dt), "q2": square, "v1": v1, "w1": w1, "v2": v2, "w2": w2}
    win["rests"] = abs(way2) < 0.003
    stops = np.minimum(abs(w1), abs(w2)) < 0.003
    win["turns"] = 0.15 * ((v1 * w1 < 0) | (v2 * w2 < 0)) + 0.5 * stops
    moving = (abs(v1) + abs(w1) > 0.02) | (abs(y1 - x1) > 0.01) | (abs(way2) > 0.01)
    return {name: column[moving] for name, column in win.items()}


def _misfit(p, kind, law, win):
    """Misfits of the balances, divided by their uncertainties; p: see LOW."""
    n, m1, m2, c1, f1, f2, r2, power = p
    loss = f2 * win["s2"] + r2 * win["x2" if law == "linear" else "q2"]
    turns = win["turns"] * win["dt"]
    rough = 0.002 * (abs(win["F"]) + n * abs(win["G"])) + turns * (f1 + n * f2)
    unsure = win["rests"] * 1e3
    taken = m2 * win["d2"] + loss - win["G"]
    both = m1 * win["d1"] + c1 * win["x1"] + f1 * win["s1"] + n * taken - win["F"]
    found = [both / np.hypot(SIGMA * np.hypot(m1, n * m2), rough) / (1 + unsure)]
    slip = n * win["v1"] - win["v2"], n * win["w1"] - win["w2"]
    way = n * win["x1"] - win["x2"]
    tolerance = 0.012 + 0.003 * (abs(win["v1"]) + abs(win["w1"]))
    stuck = (abs(slip[0]) < tolerance) & (abs(slip[1]) < tolerance) & (abs(way) < 0.01)
    error = np.hypot(SIGMA * m2, 0.002 * abs(taken) + turns * f2)
    if kind == "fluid":
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
    """Constants by steps: how the partner answers to force and slip, then the balance of both."""
    basis = win["x2" if law == "linear" else "q2"]
    rough = win["turns"] * win["dt"] * 0.5
    m2, f2, r2, power, moving = 2.0, 1.0, 1.0, 2.0, ~win["rests"]
    own, size = [win["d2"], win["s2"], basis], 2 * np.hypot(SIGMA, rough + 0.0005 * abs(win["G"]))
    if kind == "fluid":
        table = np.column_stack([*own, -win["x1"], win["x2"]])[moving]
        m2, f2, r2, pulled, power = _robust(table, win["G"][moving], size[moving])
        n = float(np.clip(pulled / (power or 1.0), 0.2, 4.5))
    elif kind == "clutch":
        slides = moving & _slides(n, win)
        if slides.sum() > 3:
            table = np.column_stack([*own, -np.sign(n * win["v1"] - win["v2"]) * win["dt"]])[slides]
            m2, f2, r2, power = _robust(table, win["G"][slides], size[slides])
    table = np.column_stack([win["d1"], win["x1"], win["s1"], *(n * column for column in own)])
    right = win["F"] + n * win["G"]
    if kind != "rigid":
        right = right - n * (m2 * win["d2"] + f2 * win["s2"] + r2 * basis)
        table = table[:, :3]
    m1, c1, f1, *rest = _robust(table, right, 2 * np.hypot(SIGMA, rough + 0.0005 * abs(win["F"])))
    m2, f2, r2 = rest or (m2, f2, r2)
    start = np.clip([n, m1, m2, c1, f1, f2, r2, power], LOW + 1e-6, HIGH - 1e-6)
    return float(np.sum(np.minimum(_misfit(start, kind, law, win) ** 2, 400))), start


def _fit(kind, law, win):
    """Misfit and constants of a structure."""
    seen = np.clip(win["w2"] / np.where(abs(win["w1"]) > 0.03, win["w1"], np.inf), 0.0, 4.0)
    ratios = [float(np.median(seen))]
    if kind == "clutch":
        ratios = [n for n in [*np.geomspace(0.35, 3.0, 24), *seen[seen > 0.25]] if _slides(n, win).any()]
    starts = sorted((_start(kind, law, win, n) for n in ratios), key=lambda entry: entry[0])[:3]
    best = (1e6, np.clip(np.ones(8), LOW, HIGH))
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


def _speed(force, f, c, q):
    """Steady speed at a net force against dry friction f and c v + q v²."""
    rest = max(abs(force) - f, 0.0)
    return np.sign(force) * (rest / c if q < 1e-9 else (np.sqrt(c * c + 4 * q * rest) - c) / (2 * q))


def _steady(kind, law, n, c1, f1, f2, r2, power):
    """Speeds of both in the end: the force that is passed on agrees with the slip."""
    own = (f2, max(r2, 1e-6), 0.0) if law == "linear" else (f2, 1e-9, max(r2, 1e-6))

    def speeds(passed):
        return _speed(FAR_N[0] - n * passed, f1, c1, 0.0), _speed(FAR_N[1] + passed, *own)

    def slip(passed):
        v1, v2 = speeds(passed)
        return n * v1 - v2

    if kind == "fluid":
        passed = brentq(lambda force: slip(force) - force / power, -500, 500)
    elif kind == "clutch" and slip(power) >= 0:
        passed = power
    elif kind == "clutch" and slip(-power) <= 0:
        passed = -power
    else:
        passed = brentq(slip, -500, 500)
    return [float(speed) for speed in speeds(passed)]


def _predict(kind, law, win):
    _, (n, _, _, c1, f1, f2, r2, power) = _fit(kind, law, win)
    return _steady(kind, law, n, c1, f1, f2, r2, power)


def fit(readings, structure):
    """Predict with the part between the carriages and the resistance of this structure."""
    kind, law = structure.split(", ")
    return _predict(kind, law, _windows(_states(readings)))


def _safe(row, forces, duration, gains):
    """Whether both stay clear of the nets in an interval and can be stopped after it."""
    for x, v, gain, own, other in zip(row[1:3], row[3:5], gains, forces, forces[::-1], strict=True):
        for force in (own + other, own, 0.5 * own):
            end, speed = x + v * duration + force * gain * duration**2 / 2, v + force * gain * duration
            stop = speed * abs(speed) / (2 * 8 * gain)
            if abs(end) > ROOM or abs(end + stop) > ROOM:
                return False
    return True


def _choose(pair, row, gains, sign):
    """Forces and time of an interval: in this sense as long as the nets are far, else in the other, else brake."""
    brake = tuple(-10.0 * float(np.sign(speed)) for speed in row[3:5])
    tries = [(pair, sign, duration) for duration in TIMES[:-3]] + [(pair, -sign, duration) for duration in TIMES[:-2]]
    tries += [(brake, 1.0, duration) for duration in TIMES[3:]]
    for forces, sense, duration in tries:
        pushed = tuple(float(sense * force) for force in forces)
        if _safe(row, pushed, duration, gains):
            return pushed, duration
    return brake, TIMES[-1]


def _gains(rows):
    """Greatest change of speed per impulse of both."""
    size = (abs(rows[1:, 5:6]) + abs(rows[1:, 6:])) * np.diff(rows[:, :1], axis=0)
    change = abs(np.diff(rows[:, 3:5], axis=0)) / np.maximum(size, 1e-9)
    return np.maximum(np.max(change[size[:, 0] > 0], axis=0), 0.05)


def _explain(exchanges):
    """Prediction of the structure that fits best; a rigid joint if it fits nearly as well."""
    win = _windows(_states(exchanges))
    costs = [(_fit(kind, law, win)[0] + 40 * (kind != "rigid"), kind, law) for kind, law in product(KINDS, LAWS)]
    _, kind, law = min(costs)
    return _predict(kind, law, win)


def solve(task):
    """Reveal the partner; push by turns, choosing sense and duration from the motion; compare all structures."""
    yield [call("find_objects")]
    exchanges, gains, sign = [], np.array([1.5, 1.5]), 1.0
    for pair in PAIRS:
        forces, duration = _choose(pair, _states(exchanges)[-1], gains, sign)
        sign = -sign if pair[0] * pair[1] < 0 or forces[0] * pair[0] * sign < 0 else sign
        plan = [*_push(forces, duration / 2), call("step", duration=duration / 2), *_state()]
        readings = yield plan
        exchanges += list(zip(plan, readings, strict=True))
        gains = _gains(_states(exchanges))
    yield [answer(_explain(exchanges))]


def batch(task):
    """Pulses fixed in advance, read at their ends."""
    pulses = (
        ((10, 0), 0.5),
        ((-10, 0), 0.7),
        ((0, 10), 0.7),
        ((-5, -10), 0.9),
        ((10, -10), 0.6),
        ((5, 10), 0.7),
        ((-10, 10), 0.7),
        ((-10, -4), 0.6),
    )
    plan = [call("find_objects"), *(made for forces, duration in pulses for made in _push(forces, duration))]
    readings = yield plan
    yield [answer(_explain(list(zip(plan, readings, strict=True))[1:]))]


def stage(task):
    """Push with the asked forces; it is refused, and 10 N and 5 N bring the carriages to other speeds."""
    readings = yield [call("find_objects"), *_push(FAR_N, 0.5), *_push((10, 5), 1.5)]
    yield [answer([reading["velocity"][0] for reading in readings if "velocity" in reading][-2:])]


def structure(knobs):
    """What joins the carriages, and how the partner is braked."""
    return f"{knobs['kind']}, {knobs['law']}"


def _resistances(knobs):
    return knobs["c1"], knobs["f1"], knobs["f2"], knobs["r2"]


def theory(knobs):
    """The steady state under both forces."""
    power = {"clutch": knobs["limit"], "fluid": knobs["fluid"], "rigid": 0.0}[knobs["kind"]]
    return _steady(knobs["kind"], knobs["law"], knobs["n"], *_resistances(knobs), power)


def naive(knobs):
    """Each carriage alone, as if nothing passed between them."""
    return {"each alone": _steady("clutch", knobs["law"], knobs["n"], *_resistances(knobs), 0.0)}


def measure(engine, knobs):
    """Push with both forces, from near the steady speeds on, with the nets a million metres away."""
    changed = engine.changed({"body[nets].pos": (1e6, 0.0, 0.0)})
    for body, force, speed in zip(("object_1", "object_2"), FAR_N, theory(knobs), strict=True):
        changed.push(body, force=np.array([force, 0.0, 0.0]))
        changed.set_velocity(body, np.array([0.9 * speed, 0.0, 0.0]))
    changed.step(changed.whole_steps(40.0))
    return [float(changed.twist(body).linear[0]) for body in ("object_1", "object_2")]
