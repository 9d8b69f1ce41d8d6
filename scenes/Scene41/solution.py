"""Scene 41: load the pan ball by ball, identify its springs from load and deflection, and extrapolate their law."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

GRAVITY = 9.81
FAR_KG, REACH_KG = 25.0, 6.0
TOP, WALL = 3.0, 0.2
RADIUS = 0.02
BALLS, BALL_KG = 18, 0.33
WAIT_S = 6.5
RESOLUTION = 5e-4
SIGMA = 0.4 * RESOLUTION
"""Standard deviation of a sink: by rounding of the place, and of the floor on which a ball is set down."""
LARGEST_M = 20.0
NO_DEVICE = {"joint[trigger_joint].damping": 1e9}
PLACES = [(0.05 * i - 0.1, 0.05 * j - 0.1) for i in range(5) for j in range(5)]
"""Where the balls lie on the floor, seen from its middle."""

CONSTANTS = {
    "preload": ("total", "offset"),
    "second": ("total", "offset", "share"),
    "leaning": ("main", "share"),
    "both": ("total", "offset", "share", "pre"),
}
RANGES = {
    "total": (30.0, 3000.0),
    "offset": (-200.0, 25.0),
    "main": (30.0, 3000.0),
    "share": (0.4, 2.5),
    "pre": (5.0, 25.0),
}
"""Upright springs together far down: their stiffness, N/m, and the force by which theirs is greater than in proportion,
N; stiffness of the first one, N/m; that of the others over it; force at the start, N."""
GAP_M = (0.025, 0.1)
NARROW_M = 1e-4
"""Error with which the way to a further spring must lie in its range."""


def _force(sink, main, pre=0.0, second=0.0, gap=0.0, level=0.0):
    """Force of the springs on the pan, upward."""
    leaning = 2 * level * sink * (1 - WALL / np.hypot(WALL, sink))
    return main * sink + pre + second * np.maximum(sink - gap, 0.0) + leaning


def _sink(kg, *parts):
    """Where the pan comes to rest under loads, by halving."""
    low, high = np.zeros(np.shape(kg)), np.full(np.shape(kg), LARGEST_M)
    for _ in range(50):
        middle = (low + high) / 2
        more = _force(middle, *parts) < GRAVITY * kg
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return low


def _parts_of(kind, constants):
    """Arguments of the force for the constants of a kind of springs."""
    found = dict(zip(CONSTANTS[kind], constants, strict=True))
    if kind == "preload":
        return found["total"], found["offset"], 0.0, 0.0, 0.0
    if kind == "leaning":
        return found["main"], 0.0, 0.0, 0.0, found["main"] * found["share"]
    main, pre = found["total"] / (1 + found["share"]), found.get("pre", 0.0)
    second = found["total"] - main
    return main, pre, second, (pre - found["offset"]) / second, 0.0


def _misfits(loads, sinks, kind):
    """Constants → misfits of the sinks, in their errors, and of what the task tells of the force or the way."""
    loads, sinks = np.array(loads), np.array(sinks)

    def misfits(constants):
        parts = _parts_of(kind, constants)
        told = parts[3] if "share" in CONSTANTS[kind] else parts[1]
        edges = {"preload": RANGES["pre"], "leaning": (0.0, 0.0)}.get(kind, GAP_M)
        beyond = told - np.clip(told, *edges)
        return np.append((_sink(loads, *parts) - sinks) / SIGMA, beyond / NARROW_M)

    return misfits


def _ranges(kind):
    return [RANGES[name] for name in CONSTANTS[kind]]


def _fitted(loads, sinks, kind):
    """Misfit and the constants that fit best."""
    misfits, ranges = _misfits(loads, sinks, kind), np.array(_ranges(kind)).T
    slope = float(np.clip(GRAVITY * loads[-1] / max(sinks[-1], RESOLUTION), 50, 1500))
    best = None
    for gap in np.linspace(0.03, 0.095, 6) if kind in {"second", "both"} else [0.05]:
        pre = 12.0 if kind in {"preload", "both"} else 0.0
        far = pre if kind == "preload" else pre - slope * gap
        known = {"total": 2 * slope, "main": slope, "offset": max(far, -190.0), "share": 1.0, "pre": pre}
        start = [known[name] for name in CONSTANTS[kind]]
        tried = least_squares(misfits, start, bounds=ranges, x_scale=np.abs(start), max_nfev=60)
        best = tried if best is None or tried.cost < best.cost else best
    return 2 * best.cost, best.x


def _far(kind, constants):
    """The sink under the far load."""
    return float(_sink(FAR_KG, *_parts_of(kind, constants)))


def _best(loads, sinks):
    """The far sink by the kind of springs that fits best, each constant paid for."""
    found = {kind: _fitted(loads, sinks, kind) for kind in CONSTANTS}
    kind = min(found, key=lambda name: found[name][0] + 3 * len(CONSTANTS[name]))
    return _far(kind, found[kind][1])


def _readings_of(exchanges):
    """Loads and sinks, in order."""
    loads, sinks, load = [], [], 0.0
    for asked, reading in exchanges:
        if asked.tool == "create_objects":
            load += asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "get_position":
            loads.append(load)
            sinks.append(TOP - reading["position"][2])
    return loads, sinks


def fit(readings, structure):
    """The sink under the far load by the law of one kind of springs."""
    return _far(structure, _fitted(*_readings_of(readings), structure)[1])


def rivals(readings):
    """Every kind of springs, fitted."""
    loads, sinks = _readings_of(readings)
    return {
        kind: member(
            _misfits(loads, sinks, kind),
            lambda constants, kind=kind: _far(kind, constants),
            _fitted(loads, sinks, kind)[1],
            _ranges(kind),
        )
        for kind in CONSTANTS
    }


def _ball(number, kg, height, radius=RADIUS):
    x, y = PLACES[number % len(PLACES)]
    density = kg / (4 / 3 * pi * radius**3)
    return call(
        "create_objects",
        name=f"ball{number}",
        pos=[x, y, height + radius],
        density=density,
        rgba=[1, 0, 0, 1],
        radius=radius,
    )


def solve(task):
    """Load the pan with one ball after another, then choose the simplest kind of springs that fits."""
    exchanges, height = [], TOP
    for number in range(BALLS):
        calls = [
            _ball(number, BALL_KG, height),
            call("step", duration=WAIT_S),
            call("get_position", object_id="object_1"),
        ]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        height = readings[-1]["position"][2]
    yield [answer(_best(*_readings_of(exchanges)))]


def stage(task):
    """Set the whole load on at once."""
    readings = yield [_ball(0, FAR_KG, TOP), call("step", duration=60), call("get_position", object_id="object_1")]
    yield [answer(TOP - readings[-1]["position"][2])]


def stage_all_at_once(task):
    """Set down all that can be made at once, and multiply what is read."""
    readings = yield [
        *(_ball(number, REACH_KG / 16, TOP) for number in range(16)),
        call("step", duration=30),
        call("get_position", object_id="object_1"),
    ]
    yield [answer((TOP - readings[-1]["position"][2]) * FAR_KG / REACH_KG)]


def batch(task):
    """Loads from the top, as heavy as the safety device permits, and then small balls that fall onto the floor."""
    calls = []
    for number, kg in enumerate((0.3, 0.5, 0.7, 0.9)):
        calls += [_ball(number, kg, TOP), call("step", duration=5), call("get_position", object_id="object_1")]
        calls += [call("delete_objects", object_id=f"ball{number}"), call("step", duration=5)]
    calls += [_ball(5, 0.9, TOP), call("step", duration=5)]
    for number in range(6, 16):
        calls += [
            _ball(number, 0.05, TOP - 0.02, 0.01),
            call("step", duration=3),
            call("get_position", object_id="object_1"),
        ]
    readings = yield calls
    loads, sinks, masses = [], [], {}
    for asked, reading in zip(calls, readings, strict=True):
        if asked.tool == "create_objects" and "error" not in reading:
            masses[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "delete_objects":
            masses.pop(asked.arguments["object_id"], None)
        elif asked.tool == "get_position" and "error" not in reading:
            loads.append(sum(masses.values()))
            sinks.append(TOP - reading["position"][2])
    yield [answer(_best(loads, sinks))]


def structure(knobs):
    """Which springs there are."""
    return knobs["kind"]


def _parts(knobs):
    return knobs["main"], knobs["F0"], knobs["K2"], knobs["gap"], knobs["KS"]


def naive(knobs):
    """The greatest sink within reach in proportion, and the first slope carried on."""
    return {
        "in proportion": float(_sink(REACH_KG, *_parts(knobs))) * FAR_KG / REACH_KG,
        "first slope": (GRAVITY * FAR_KG - knobs["F0"]) / knobs["main"],
    }


def theory(knobs):
    """Balance of the load and the springs."""
    return float(_sink(FAR_KG, *_parts(knobs)))


def _loaded(engine, sink):
    """The engine's pan without the safety device, let go at a sink under the far load: where it comes to rest."""
    free = engine.changed(NO_DEVICE)
    free.place("object_1", np.array([0.0, 0.0, TOP - sink]), {})
    free.push("object_1", force=np.array([0.0, 0.0, -GRAVITY * FAR_KG]))
    free.step(free.whole_steps(20.0))
    return float(TOP - free.pose("object_1").position[2])


def measure(engine, knobs):
    """The engine's pan, loaded at its highest place."""
    return _loaded(engine, 0.0)


def settles(engine, knobs, off):
    """By which share the pan is off the asked sink in the end."""
    return _loaded(engine, (1 + off) * theory(knobs)) / theory(knobs) - 1
