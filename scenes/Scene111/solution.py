"""Scene 111: bring both sliders out step by step with heavier and heavier balls; carry the laws of the springs on."""

from math import cos, pi, sin

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

SPIN, STOP_M, CATCH_M = 6.0, 0.3, 0.3
FAR_SPIN, FAR_M = 12.0, 1.2
SLIDERS = ("object_2", "object_3")
HEIGHT, DENSITY = 1.1, 1e5
WAIT_S = 6.0
FIRST_KG = 0.004
TURNS = 14
GOALS = (0.06, 0.12, 0.16, 0.19, 0.212, 0.23, 0.246, 0.258, 0.268, 0.277, 0.285, 0.291)
"""Distances from the stop that are aimed at, m."""
SIGMA = 1.5e-4
"""Standard deviation of a distance that is read, m."""
KINDS = ("even", "cubic", "late")
EDGES = np.linspace(0.185, 0.255, 15)


def _pull(u, k, part=0.0, edge=None):
    """Pull of a spring: even, with a third power, or with a second part from an edge on."""
    return k * u + part * (u**3 if edge is None else np.maximum(u - edge, 0.0))


def _fitted(points, kind):
    """Misfit and numbers of a spring of one kind."""
    u, force = np.array(points).T
    slope = np.gradient(force, u + 1e-7 * np.arange(len(u))) if len(u) > 2 else force / u
    size = np.maximum(slope, 0.3 * force / u) * SIGMA + 1e-3 * force

    def solved(edge):
        table = {"even": [u], "cubic": [u, u**3], "late": [u, np.maximum(u - (edge or 0.0), 0.0)]}[kind]
        table = np.column_stack(table) / size[:, None]
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, force / size, rcond=None)[0] / scale
        return table @ found - force / size, found

    edge = None
    if kind == "late":
        edge = min(EDGES, key=lambda edge: float((solved(edge)[0] ** 2).sum()))
        edge = float(least_squares(lambda at: solved(at[0])[0], [edge], bounds=(0.18, 0.262), diff_step=1e-4).x[0])
    misfit, found = solved(edge)
    cost = float((misfit**2).sum())
    if kind != "even":
        least = (3.0 if kind == "cubic" else 0.7) * found[0]
        cost += 1e3 * (found[1] < least)
        found = (found[0], max(found[1], least))
    return cost, (*map(float, found), *((edge,) if kind == "late" else ()))


def _load(laws):
    """Load that rests at the far place at the far spin."""
    return sum(float(_pull(FAR_M - STOP_M, *law)) for law in laws) / FAR_SPIN**2 / FAR_M


def _points(exchanges):
    """Distances from the stop and forces that balance the pull there, for both sliders."""
    points, made, held, far = {name: [] for name in SLIDERS}, {}, {}, dict.fromkeys(SLIDERS, STOP_M)
    for asked, reading in exchanges:
        if "error" in reading or not reading:
            continue
        if asked.tool == "create_objects":
            kg = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
            made[asked.arguments["name"]] = (kg, float(np.hypot(*reading["position"][:2])))
        elif asked.tool == "attach_objects":
            ball, slider = asked.arguments["object1_id"], asked.arguments["object2_id"]
            held[slider] = (made[ball][0], made[ball][1] - far[slider])
        elif asked.tool == "get_position" and asked.arguments["object_id"] in held:
            slider = asked.arguments["object_id"]
            far[slider] = float(np.hypot(*reading["position"][:2]))
            kg, farther = held[slider]
            u = far[slider] - STOP_M
            if 0.002 < u < CATCH_M:
                points[slider].append((u, kg * SPIN**2 * (far[slider] + farther)))
    return {name: sorted(found) for name, found in points.items()}


def _best(points):
    """The load by the kinds that fit best, each number paid for."""
    laws = []
    for own in points.values():
        found = [_fitted(own, kind) for kind in KINDS] if len(own) > 1 else [(0.0, (10.0,))]
        laws.append(min(found, key=lambda fit: fit[0] + 4 * len(fit[1]))[1])
    return _load(laws)


def fit(readings, structure):
    """The load by springs of these kinds."""
    points = _points(readings)
    return _load([_fitted(points[name], kind)[1] for name, kind in zip(SLIDERS, structure.split(", "), strict=True)])


def _ball(slider, number, kg, place):
    """A ball where the slider is, joined to it."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [*place, HEIGHT + 0.06 * (number % 2)]
    name = f"b{slider[-1]}_{number}"
    made = call("create_objects", name=name, pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    return [made, call("attach_objects", object1_id=name, object2_id=slider)]


def solve(task):
    """Replace the ball of each slider by a heavier one, again and again; each follows from where the slider is."""
    exchanges, mass = [], dict.fromkeys(SLIDERS, FIRST_KG)
    place = {"object_2": [STOP_M, 0.0], "object_3": [-STOP_M, 0.0]}
    rows = {name: [(0.0, 0.0)] for name in SLIDERS}
    active = list(SLIDERS)
    for number in range(TURNS):
        calls = []
        for slider in active:
            calls += _ball(slider, number, mass[slider], place[slider])
            if number:
                calls.append(call("delete_objects", object_id=f"b{slider[-1]}_{number - 1}"))
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=slider) for slider in active)]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        for slider, reading in zip(active, readings[-len(active) :], strict=True):
            place[slider] = reading["position"][:2]
            u = float(np.hypot(*place[slider])) - STOP_M
            rows[slider].append((u, mass[slider] * SPIN**2 * (STOP_M + u)))
            goal = next((goal for goal in GOALS if goal > u + 0.006), None)
            if goal is None:
                continue
            (a, before), (_, now) = rows[slider][-2:]
            slope = (now - before) / max(u - a, 5e-4)
            mass[slider] = max((now + slope * (goal - u)) / SPIN**2 / (STOP_M + goal), 1.01 * mass[slider])
        active = [slider for slider in SLIDERS if rows[slider][-1][0] < GOALS[-1] - 0.006]
        if not active:
            break
    yield [answer(_best(_points(exchanges)))]


def batch(task):
    """Six masses in even ratios for each slider, and the best fit."""
    calls = []
    for number in range(6):
        angle = SPIN * WAIT_S * number
        for slider, side in zip(SLIDERS, (1, -1), strict=True):
            place = [side * (STOP_M + 0.04 * number) * part for part in (cos(angle), sin(angle))]
            calls += _ball(slider, number, 0.015 * 400 ** (number / 5), place)
            if number:
                calls.append(call("delete_objects", object_id=f"b{slider[-1]}_{number - 1}"))
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=slider) for slider in SLIDERS)]
    readings = yield calls
    yield [answer(_best(_points(list(zip(calls, readings, strict=True)))))]


def stage(task):
    """Join a load to a slider, and carry it over in proportion to the distance from the stop."""
    calls = [*_ball("object_2", 0, 0.02, [STOP_M, 0.0]), call("step", duration=WAIT_S)]
    readings = yield [*calls, call("get_position", object_id="object_2")]
    u = max(float(np.hypot(*readings[-1]["position"][:2])) - STOP_M, 1e-3)
    yield [answer(0.02 * (SPIN / FAR_SPIN) ** 2 * (STOP_M + u) / u * (FAR_M - STOP_M) / FAR_M)]


def structure(knobs):
    """Laws of the two springs."""
    return knobs["kinds"]


def _law(knobs, number):
    kind, k = knobs["kinds"].split(", ")[number - 1], knobs[f"k{number}"]
    parts = {
        "even": (),
        "cubic": (k / knobs[f"w{number}"] ** 2,),
        "late": (k * knobs[f"q{number}"], knobs[f"s{number}"]),
    }
    return (k, *parts[kind])


def naive(knobs):
    """The stiffnesses at small distances."""
    return {"stiffness at small distances": _load([(knobs["k1"],), (knobs["k2"],)])}


def theory(knobs):
    """The pulls of both springs at the far place."""
    return _load([_law(knobs, 1), _law(knobs, 2)])


def measure(engine, knobs):
    """Where each slider of the engine's disk, at rest, comes under the far pull of its spring."""
    changes = {f"joint[rail{i}].range": (0.0, 10.0) for i in (1, 2)}
    changes |= {f"joint[trigger{i}_joint].damping": 1e9 for i in (1, 2)}
    still = engine.changed(changes, without=("key[start]",))
    pulls = [float(_pull(FAR_M - STOP_M, *_law(knobs, i))) for i in (1, 2)]
    for slider, side, pull in zip(SLIDERS, (1, -1), pulls, strict=True):
        still.push(slider, force=np.array([side * pull, 0.0, 0.0]))
    still.step(still.whole_steps(10.0))
    out = sum(abs(float(still.pose(slider).position[0])) - STOP_M for slider in SLIDERS)
    return theory(knobs) * 2 * (FAR_M - STOP_M) / out
