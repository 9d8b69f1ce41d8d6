"""Scene 111: bring both sliders out step by step with heavier and heavier balls; carry the laws of the springs on."""

from math import cos, sin

import numpy as np

from scenes.courses import accepted
from scenes.loads import dense_ball, joined, mass_of
from scenes.protocol import answer, call
from scenes.springs import best, drawn, drawn_kinds, fitted, members, next_load, pull

structure = drawn_kinds
SPIN, STOP_M, CATCH_M = 6.0, 0.3, 0.3
FAR_SPIN, FAR_M = 12.0, 1.2
SLIDERS = ("object_2", "object_3")
STARTS = dict(zip(SLIDERS, ([STOP_M, 0.0], [-STOP_M, 0.0]), strict=True))
HEIGHT, DENSITY = 1.1, 1e5
FIRST_KG, WAIT_S, TURNS = 0.004, 6.0, 14
SIGMA = 8e-5
"""Standard deviation of a distance from the stop: of its resolution, and of what is missing to rest, m."""
SOFT = 10.0
"""Stiffness of a spring of which too little is known, N/m."""


def _load(laws):
    """Load that rests at the far place at the far spin."""
    return sum(float(pull(FAR_M - STOP_M, *law)) for law in laws) / FAR_SPIN**2 / FAR_M


def _radius(reading):
    """Distance from the axis."""
    return float(np.hypot(*reading["position"][:2]))


def _points(exchanges):
    """Distances from the stop and forces that balance the pull there, for both sliders."""
    points, made, held, far = {name: [] for name in SLIDERS}, {}, {}, dict.fromkeys(SLIDERS, STOP_M)
    for asked, reading in accepted(exchanges):
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = mass_of(asked), _radius(reading)
        elif asked.tool == "attach_objects":
            kg, place = made[asked.arguments["object1_id"]]
            slider = asked.arguments["object2_id"]
            held[slider] = kg, place - far[slider]
        elif asked.tool == "get_position" and asked.arguments["object_id"] in held:
            slider = asked.arguments["object_id"]
            far[slider], (kg, farther) = _radius(reading), held[slider]
            if 0.002 < far[slider] - STOP_M < CATCH_M:
                points[slider].append((far[slider] - STOP_M, kg * SPIN**2 * (far[slider] + farther)))
    return [sorted(own) for own in points.values()]


def _best(exchanges):
    """The load by the kinds that fit best."""
    return _load([best(own, SOFT) for own in _points(exchanges)])


def fit(readings, structure):
    """The load by springs of these kinds."""
    kinds = structure.split(", ")
    return _load([fitted(own, kind)[1] for own, kind in zip(_points(readings), kinds, strict=True)])


def rivals(readings):
    """Springs of all kinds, fitted."""
    return members(_points(readings), _load, SIGMA)


def _ball(slider, number, kg, place):
    """Join a ball to a slider where it is, and take the one before away."""
    name = f"b{slider[-1]}_{number}"
    made = joined(dense_ball(name, kg, [*place, HEIGHT + 0.06 * (number % 2)], DENSITY), slider)
    return made + [call("delete_objects", object_id=f"b{slider[-1]}_{number - 1}")] * (number > 0)


def _rest(sliders):
    return [call("step", duration=WAIT_S), *(call("get_position", object_id=slider) for slider in sliders)]


def solve(task):
    """Replace the ball of each slider by a heavier one, again and again; each follows from where the slider is."""
    seen, place = [], dict(STARTS)
    rows, masses = {name: [(0.0, 0.0)] for name in SLIDERS}, dict.fromkeys(SLIDERS, FIRST_KG)
    for number in range(TURNS):
        active = list(masses)
        calls = [made for slider in active for made in _ball(slider, number, masses[slider], place[slider])]
        calls += _rest(active)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        for slider, reading in zip(active, readings[-len(active) :], strict=True):
            place[slider], kg = reading["position"][:2], masses.pop(slider)
            rows[slider].append((_radius(reading) - STOP_M, kg * SPIN**2 * _radius(reading)))
            if ahead := next_load(rows[slider]):
                goal, force = ahead
                masses[slider] = max(force / SPIN**2 / (STOP_M + goal), 1.01 * kg)
        if not masses:
            break
    yield [answer(_best(seen))]


def batch(task):
    """Six masses in even ratios for each slider, and the best fit."""
    calls = []
    for number in range(6):
        angle, out = SPIN * WAIT_S * number, 1 + 0.04 * number / STOP_M
        for slider, (x, _) in STARTS.items():
            calls += _ball(slider, number, 0.015 * 400 ** (number / 5), [out * x * part(angle) for part in (cos, sin)])
        calls += _rest(SLIDERS)
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Join a load to a slider, and carry it over in proportion to the distance from the stop."""
    readings = yield [*_ball("object_2", 0, 0.02, STARTS["object_2"]), *_rest(["object_2"])]
    u = max(_radius(readings[-1]) - STOP_M, 1e-3)
    yield [answer(0.02 * (SPIN / FAR_SPIN) ** 2 * (STOP_M + u) / u * (FAR_M - STOP_M) / FAR_M)]


def naive(knobs):
    """The stiffnesses at small distances."""
    return {"stiffness at small distances": _load([(knobs["k1"],), (knobs["k2"],)])}


def theory(knobs):
    """The pulls of both springs at the far place."""
    return _load([drawn(knobs, 1), drawn(knobs, 2)])


def measure(engine, knobs):
    """Where each slider of the engine's disk, at rest, comes under the far pull of its spring."""
    changes = {f"joint[rail{i}].range": (0.0, 10.0) for i in (1, 2)}
    changes |= {f"joint[trigger{i}_joint].damping": 1e9 for i in (1, 2)}
    still = engine.changed(changes, without=("key[start]",))
    pulls = [float(pull(FAR_M - STOP_M, *drawn(knobs, i))) for i in (1, 2)]
    for slider, side, newtons in zip(SLIDERS, (1, -1), pulls, strict=True):
        still.push(slider, force=np.array([side * newtons, 0.0, 0.0]))
    still.step(still.whole_steps(10.0))
    out = sum(abs(float(still.pose(slider).position[0])) - STOP_M for slider in SLIDERS)
    return theory(knobs) * 2 * (FAR_M - STOP_M) / out


def settles(engine, knobs, off):
    """Where the load comes to rest on the engine's disk if both springs pull it and it begins near the asked place."""
    kg, begin = theory(knobs), FAR_M * (1 + off)
    changes = {"key[start].qvel": (FAR_SPIN, 0, 0, 0, 0), "joint[rail2].axis": (1, 0, 0)}
    for i, slider in enumerate(SLIDERS, 1):
        changes |= {f"joint[trigger{i}_joint].damping": 1e9, f"joint[rail{i}].range": (-5.0, 5.0)}
        changes |= {f"body[{slider}].pos": (begin, 0.0, 0.1)}
        changes |= {f"body[{slider}]/inertial.mass": knobs[f"k{i}"] / 150 + kg / 2}
    free = engine.changed(changes)
    free.join(*SLIDERS, "weld")
    free.step(free.whole_steps(30.0))
    return float(np.hypot(*free.centre(SLIDERS[0])[:2])) / FAR_M - 1
