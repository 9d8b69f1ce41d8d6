"""Scene 103: spins of one wheel, two and three under growing loads; the laws of the resistances from the sums."""

from itertools import permutations
from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, ARM, FAR_SPIN = 9.81, 0.1, 40.0
BRAKE, SLOWEST = 10.0, 1.0
KINDS = ("even", "square", "late")
DENSITY, HEIGHT = 1e5, 1.0
WAIT_S = 9.0
FIRST_KG = 0.01
TURNS = 6
SIGMA = 1.5e-3
"""Standard deviation of a spin that is read, rad/s."""
CHANGED, STEEPER, END = 8.0, 1.0, 9.6
"""Spin beyond which no law changes, and spin up to which the wheels are turned, rad/s."""
GOALS = (2.5, 4.5, 6.5, 7.6, 8.6, 9.4)
"""Spins that are aimed at, rad/s."""
EDGES = np.linspace(5.5, 8.0, 26)


def _columns(kind, spin, edge):
    """What the resistance is linear in."""
    return {"even": [spin], "square": [spin**2], "late": [spin, np.maximum(spin - edge, 0.0)]}[kind]


def _fitted(rows, kinds):
    """Misfit, and resistance of each wheel at the far spin, if they are of these kinds."""
    spin, torque, there = rows[:, 0], rows[:, 1], rows[:, 2:]
    size = torque / spin * 2 * SIGMA + 1e-3 * torque

    def solved(edge):
        parts = [_columns(kind, spin, edge) for kind in kinds]
        table = [column * there[:, wheel] for wheel, part in enumerate(parts) for column in part]
        table = np.column_stack(table) / size[:, None]
        scale = np.linalg.norm(table, axis=0) + 1e-12
        found = np.linalg.lstsq(table / scale, torque / size, rcond=None)[0] / scale
        return table @ found - torque / size, found

    edge = min(EDGES, key=lambda edge: float((solved(edge)[0] ** 2).sum()))
    edge = float(least_squares(lambda at: solved(at[0])[0], [edge], bounds=(5.3, 8.2), diff_step=1e-4).x[0])
    misfit, found = solved(edge)
    cost, left, far = float((misfit**2).sum()), list(map(float, found)), []
    cost += 1e3 * sum(number < 0 for number in left)
    for kind in kinds:
        columns = _columns(kind, np.float64(FAR_SPIN), edge)
        far += [sum(left.pop(0) * float(column) for column in columns)]
    return cost, far


def _rows(exchanges):
    """Rows of spin, torque of the motor, and which wheels turn."""
    rows, made, load, there = [], {}, 0.0, [1.0, 0.0, 0.0]
    for asked, reading in exchanges:
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            name = asked.arguments["object1_id"]
            if name in made:
                load += made[name]
            else:
                there[int(name[-1]) - 1] = 1.0
        elif asked.tool == "delete_objects":
            load -= made[asked.arguments["object_id"]]
        elif asked.tool == "get_velocity" and SLOWEST < (spin := reading["angular_velocity"]) < BRAKE:
            rows.append((spin, ARM * GRAVITY * load, *there))
    return np.array(rows)


def _best(rows):
    """Torque of the second and the third wheel at the far spin, by the kinds that fit best."""
    return sum(min((_fitted(rows, kinds) for kinds in permutations(KINDS)), key=lambda found: found[0])[1][1:])


def fit(readings, structure):
    """The far torque with resistances of these kinds."""
    return sum(_fitted(_rows(readings), tuple(structure.split(", ")))[1][1:])


def _load(number, kg):
    """Load the pan with a ball instead of the one before, wait, and read the spin."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [1.0 + 0.1 * (number % 2), 0.0, HEIGHT]
    made = call("create_objects", name=f"b{number}", pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    join = call("attach_objects", object1_id=f"b{number}", object2_id="object_4")
    return [made, join, *old, call("step", duration=WAIT_S), call("get_velocity", object_id="object_1")]


def solve(task):
    """Turn one wheel, two and three, each time up to just below the brake; each load follows from the spins before."""
    exchanges, number, first = [], 0, FIRST_KG
    for joined in (None, "object_2", "object_3"):
        calls = [call("attach_objects", object1_id=joined, object2_id="object_1")] if joined else []
        kg, points = first, [(0.0, 0.0)]
        for turn in range(TURNS):
            calls += _load(number, kg)
            number += 1
            readings = yield calls
            exchanges += zip(calls, readings, strict=True)
            points.append((readings[-1]["angular_velocity"], kg))
            (before, lighter), (spin, kg) = points[-2:]
            if spin > GOALS[-1] - 0.3 or turn == TURNS - 1:
                break
            slope = (kg - lighter) / max(spin - before, 1e-2)
            goal = next(goal for goal in (GOALS if turn < TURNS - 3 else GOALS[3:]) if goal > spin + 0.4)
            kg, calls = min(max(kg + slope * (goal - spin), 1.05 * kg), 80 * kg), []
        first = kg * GOALS[1] / max(spin, 1.0)
    yield [answer(float(_best(_rows(exchanges))))]


def batch(task):
    """Four loads in even ratios on one wheel, two and three, and the best fit."""
    calls = []
    for stage_number, joined in enumerate((None, "object_2", "object_3")):
        calls += [call("attach_objects", object1_id=joined, object2_id="object_1")] if joined else []
        for rung in range(4 - (stage_number > 0)):
            calls += _load(len([asked for asked in calls if asked.tool == "step"]), 0.1 * 3.0 ** (rung + stage_number))
    readings = yield calls
    rows = _rows(list(zip(calls, readings, strict=True)))
    yield [answer(float(_best(rows)) if len(rows) > 3 else 10.0)]


def stage(task):
    """Join all three wheels, and carry the torque of one spin over in proportion."""
    calls = [call("attach_objects", object1_id=f"object_{i}", object2_id="object_1") for i in (2, 3)]
    readings = yield [*calls, *_load(0, FIRST_KG)]
    yield [answer(ARM * GRAVITY * FIRST_KG * FAR_SPIN / max(readings[-1]["angular_velocity"], 0.01) / 3)]


def structure(knobs):
    """Kinds of the three resistances."""
    return ", ".join(knobs["kinds"])


def _resistance(knobs, wheel, spin):
    kind, scale = knobs["kinds"][wheel - 1], knobs["scale"]
    if kind == "even":
        return scale * knobs["even"] * spin
    if kind == "square":
        return scale * knobs["square"] / 8 * spin**2
    return scale * knobs["late"] * (spin + knobs["more"] * max(spin - knobs["edge"], 0.0))


def naive(knobs):
    """The torque of both at 5 rad/s, carried over in proportion to the spin."""
    return {"in proportion": sum(_resistance(knobs, wheel, 5.0) for wheel in (2, 3)) * FAR_SPIN / 5}


def theory(knobs):
    """Sum of both resistances at the far spin."""
    return sum(_resistance(knobs, wheel, FAR_SPIN) for wheel in (2, 3))


def measure(engine, knobs):
    """Torque at the far spin, where the engine's wheels 2 and 3 together come to a steady spin under a torque."""
    torque = theory(knobs)
    engine.remove("object_1")
    engine.join("object_2", "object_3", "weld")
    engine.push("object_2", torque=np.array([0.0, 0.0, torque]))
    engine.step(engine.whole_steps(15.0))
    spin = float(engine.turn("object_3").spin)
    return (
        torque
        * sum(_resistance(knobs, wheel, FAR_SPIN) for wheel in (2, 3))
        / sum(_resistance(knobs, wheel, spin) for wheel in (2, 3))
    )
