"""Scene 102: take out the latches, load both pans step by step, and carry the laws of the springs on to the energy."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, TOP_M, CATCH_M = 9.81, 2.0, 0.3
FAR_M = 0.9
PANS = {"object_1": -0.3, "object_2": 0.3}
"""Pans, and where they stand along x, m."""
DENSITY = 1e5
WAIT_S = 6.0
FIRST_KG = 0.004
TURNS = 14
GOALS = (0.06, 0.12, 0.16, 0.19, 0.212, 0.23, 0.246, 0.258, 0.268, 0.277, 0.285, 0.291)
"""Compressions that are aimed at, m."""
SIGMA = 1.5e-4
"""Standard deviation of a place that is read, m."""
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


def _energy(u, k, part=0.0, edge=None):
    """Energy of a compressed spring."""
    return k * u**2 / 2 + (part * u**4 / 4 if edge is None else part * max(u - edge, 0.0) ** 2 / 2)


def _work(laws):
    """Energy of both springs at the far compression."""
    return sum(_energy(FAR_M, *law) for law in laws)


def _points(exchanges):
    """Compressions and forces of both springs."""
    points, made, held = {name: [] for name in PANS}, {}, {}
    for asked, reading in exchanges:
        if "error" in reading or not reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            held[asked.arguments["object2_id"]] = made[asked.arguments["object1_id"]]
        elif asked.tool == "get_position":
            pan = asked.arguments["object_id"]
            u = TOP_M - reading["position"][2]
            if 0.002 < u < CATCH_M:
                points[pan].append((u, GRAVITY * held[pan]))
    return {name: sorted(found) for name, found in points.items()}


def _best(points):
    """The work by the kinds that fit best, each number paid for."""
    laws = []
    for own in points.values():
        found = [_fitted(own, kind) for kind in KINDS] if len(own) > 1 else [(0.0, (30.0,))]
        laws.append(min(found, key=lambda fit: fit[0] + 4 * len(fit[1]))[1])
    return _work(laws)


def fit(readings, structure):
    """The work by springs of these kinds."""
    points = _points(readings)
    return _work([_fitted(points[name], kind)[1] for name, kind in zip(PANS, structure.split(", "), strict=True)])


def _ball(pan, number, kg):
    """A ball at the pan's first place, joined to it, instead of the one before."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    name = f"b{pan[-1]}_{number}"
    where = [PANS[pan], 0.3 * (number % 2) - 0.15, TOP_M]
    made = call("create_objects", name=name, pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    old = [call("delete_objects", object_id=f"b{pan[-1]}_{number - 1}")] if number else []
    return [made, call("attach_objects", object1_id=name, object2_id=pan), *old]


def _unlatched():
    return [call("delete_objects", object_id=latch) for latch in ("object_3", "object_4")]


def solve(task):
    """Replace the ball on each pan by a heavier one, again and again; each follows from where the pan is."""
    exchanges, mass, active = [], dict.fromkeys(PANS, FIRST_KG), list(PANS)
    rows = {name: [(0.0, 0.0)] for name in PANS}
    for number in range(TURNS):
        calls = [] if number else _unlatched()
        for pan in active:
            calls += _ball(pan, number, mass[pan])
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=pan) for pan in active)]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        for pan, reading in zip(active, readings[-len(active) :], strict=True):
            u = TOP_M - reading["position"][2]
            rows[pan].append((u, mass[pan]))
            goal = next((goal for goal in GOALS if goal > u + 0.006), None)
            if goal is None:
                continue
            (a, before), (_, now) = rows[pan][-2:]
            slope = (now - before) / max(u - a, 5e-4)
            mass[pan] = max(now + slope * (goal - u), 1.01 * now)
        active = [pan for pan in PANS if rows[pan][-1][0] < GOALS[-1] - 0.006]
        if not active:
            break
    yield [answer(_best(_points(exchanges)))]


def batch(task):
    """Six loads in even ratios on each pan, and the best fit."""
    calls = _unlatched()
    for number in range(6):
        for pan in PANS:
            calls += _ball(pan, number, 0.05 * 2000 ** (number / 5))
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=pan) for pan in PANS)]
    readings = yield calls
    yield [answer(_best(_points(list(zip(calls, readings, strict=True)))))]


def stage(task):
    """Load one spring a little, and carry its energy over with the square of the compression."""
    calls = [*_unlatched(), *_ball("object_1", 0, FIRST_KG), call("step", duration=WAIT_S)]
    readings = yield [*calls, call("get_position", object_id="object_1")]
    u = max(TOP_M - readings[-1]["position"][2], 1e-3)
    yield [answer(FIRST_KG * GRAVITY / u * FAR_M**2)]


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
    """The stiffnesses at small compressions."""
    return {"stiffness at small compressions": _work([(knobs["k1"],), (knobs["k2"],)])}


def theory(knobs):
    """Energy of both springs."""
    return _work([_law(knobs, 1), _law(knobs, 2)])


def measure(engine, knobs):
    """Energies of the springs from the speeds that they give to the engine's pans, made heavy, when they let go."""
    kg, energy = 50.0, 0.0
    for i, pan in enumerate(PANS, 1):
        changes = {f"body[{pan}]/inertial.mass": kg, f"joint[guide{i}].damping": 0.0}
        changes |= {f"joint[guide{i}].range": (-5.0, 5.0), f"joint[trigger{i}_joint].damping": 1e9}
        free = engine.changed(changes)
        free.remove(f"object_{i + 2}")
        where = free.pose(pan).position.copy()
        where[2] = TOP_M - FAR_M
        free.place(pan, where, {})
        speed = 0.0
        while free.pose(pan).position[2] < TOP_M:
            free.step(1)
            speed = max(speed, float(free.twist(pan).linear[2]))
        energy += kg * speed**2 / 2
    return energy
