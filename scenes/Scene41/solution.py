"""Scene 41: load the pan ball by ball, decide which springs bear it, and carry their law on."""

from math import pi

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

GRAVITY = 9.81
FAR_KG, REACH_KG = 25.0, 6.0
TOP, WALL = 3.0, 0.2
RADIUS = 0.02
BALLS, BALL_KG = 16, 0.375
WAIT_S = 6.5
RESOLUTION = 5e-4
PLACES = [(0.06 * i - 0.09, 0.06 * j - 0.09) for i in range(4) for j in range(4)]
"""Where the balls lie on the floor, seen from its middle."""

PARTS = {"preload": 2, "second": 3, "leaning": 2, "both": 4}
"""How many numbers describe each kind of springs."""


def _force(sink, kind, main, pre=0.0, second=0.0, gap=0.0, level=0.0):
    """Force of the springs on the pan, upward."""
    force = main * sink
    if kind in {"preload", "both"}:
        force = force + pre
    if kind in {"second", "both"}:
        force = force + second * np.maximum(sink - gap, 0.0)
    if kind == "leaning":
        force = force + 2 * level * sink * (1 - WALL / np.hypot(WALL, sink))
    return force


def _sink(kg, kind, *parts):
    """Where the pan comes to rest under a load."""
    if _force(0.0, kind, *parts) >= GRAVITY * kg:
        return 0.0
    return float(brentq(lambda sink: _force(sink, kind, *parts) - GRAVITY * kg, 0.0, 20.0))


def _fitted(loads, sinks, kind):
    """Misfit in units of the resolution, and the sink under the far load, for one kind of springs."""
    loads, sinks = np.array(loads), np.array(sinks)
    moved = sinks > RESOLUTION
    slope = np.polyfit(GRAVITY * loads[moved], sinks[moved], 1)[0] if moved.sum() > 1 else 1 / 300

    def parts(logs, gap):
        main, pre, other = np.exp(logs)
        return (main, pre, other, gap, other)

    def misfit(values, gap=None):
        found = parts(values[:3], values[3] if gap is None else gap)
        return [(_sink(kg, kind, *found) - sink) / (0.4 * RESOLUTION) for kg, sink in zip(loads, sinks, strict=True)]

    gaps = np.linspace(0.015, 0.095, 9) if kind in {"second", "both"} else [0.05]
    best = None
    for gap in gaps:
        start = [np.log(min(max(1 / slope, 100), 2000)), np.log(10.0), np.log(200.0), gap]
        low, high = [3.0, -1.0, 1.0, 0.0], [8.5, 4.0, 8.5, 0.12]
        tried = least_squares(misfit, start, bounds=(low, high), x_scale=[0.3, 0.3, 0.5, 0.01], max_nfev=60)
        if best is None or tried.cost < best.cost:
            best = tried
    return 2 * best.cost, _sink(FAR_KG, kind, *parts(best.x[:3], best.x[3]))


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
    return _fitted(*_readings_of(readings), structure)[1]


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
    """Set down ball after ball on the floor, then take the simplest kind of springs that fits."""
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
    loads, sinks = _readings_of(exchanges)
    found = {kind: _fitted(loads, sinks, kind) for kind in PARTS}
    best = min(PARTS, key=lambda kind: found[kind][0] + 3 * PARTS[kind])
    yield [answer(found[best][1])]


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
    found = {kind: _fitted(loads, sinks, kind) for kind in PARTS}
    best = min(PARTS, key=lambda kind: found[kind][0] + 3 * PARTS[kind])
    yield [answer(found[best][1])]


def structure(knobs):
    """Which springs there are."""
    return knobs["kind"]


def _parts(knobs):
    return knobs["main"], knobs["F0"], knobs["K2"], knobs["gap"], knobs["KS"]


def naive(knobs):
    """The greatest sink within reach in proportion, and the first slope carried on."""
    kind, parts = knobs["kind"], _parts(knobs)
    return {
        "in proportion": _sink(REACH_KG, kind, *parts) * FAR_KG / REACH_KG,
        "first slope": (GRAVITY * FAR_KG - knobs["F0"]) / knobs["main"],
    }


def theory(knobs):
    """Balance of the load and the springs."""
    return _sink(FAR_KG, knobs["kind"], *_parts(knobs))


def measure(engine, knobs):
    """The engine's pan under a load that grows slowly enough for the safety device."""
    pieces = 1200
    for piece in range(1, pieces + 1):
        engine.push("object_1", force=np.array([0.0, 0.0, -GRAVITY * FAR_KG * piece / pieces]))
        engine.step(engine.whole_steps(0.05))
    engine.step(engine.whole_steps(10.0))
    return float(TOP - engine.pose("object_1").position[2])
