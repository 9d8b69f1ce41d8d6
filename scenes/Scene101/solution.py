"""Scene 101: turn the wheel for long, fast and slowly; what its resistance has grown with tells the fast run."""

from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

GRAVITY, ARM, BRAKE = 9.81, 0.1, 10.0
FRESH, AFTER_S = 25.0, 60.0
"""Spin at which the fresh bearing would take up the asked torque, rad/s; time until then."""
DENSITY, HEIGHT = 1e5, 1.0
UNITS = {"time": 100.0, "turns": 700.0, "work": 9800.0}
"""Time, angle, or work over the first resistance, after which the resistance has doubled, about."""
KINDS = tuple(UNITS)
NOISE = 0.025
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.001, 8.0, 0.45, 3.0
PLAN = ((4.5, 3), (9.2, 4), (9.3, 4), (7.0, 5), (9.3, 4), (7.0, 5), (9.3, 4), (4.5, 3), (9.3, 4))
"""Spins that are aimed at, and how many looks there are at each."""
LOOK_S = 4.0
LAG_S = 0.35
"""How late the wheel follows a new load, about: the pan sinks and the wheel gathers speed."""


def _course(exchanges):
    """Torques and spins, until the brake stops the wheel."""
    made, load, legs = {}, 0.0, []
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            load += made[asked.arguments["object1_id"]]
        elif asked.tool == "delete_objects":
            load -= made[asked.arguments["object_id"]]
        elif asked.tool == "step":
            legs.append([asked.arguments["duration"], ARM * load * GRAVITY, np.nan])
        elif asked.tool == "get_velocity" and legs:
            spin = reading["angular_velocity"]
            if spin > BRAKE + 0.1 or (
                len(legs) > 1 and spin < 0.3 * (legs[-2][2] or 0.0) and legs[-1][1] >= legs[-2][1]
            ):
                legs.pop()
                break
            legs[-1][2] = spin
    times, torques, spins = np.array(legs or [[1.0, 0.01, 1.0]]).T
    return times, torques, spins


def _spins(kind, times, drives, life, edge):
    """Spins at the ends of legs with these drives (torque over the first resistance), for many trials at once."""
    worn, spins, before = 1.0 + 0.0 * (life + edge), [], 0.0 * drives[0]
    for time, drive in zip(times, drives, strict=True):
        for lasting, held in ((LAG_S, before), (time - LAG_S, drive)):
            # As long as the wheel wears, the resistance grows evenly with the time, or its square does.
            grown = {
                "time": worn + lasting / life,
                "turns": np.sqrt(worn**2 + 2 * abs(held) * lasting / life),
                "work": np.sqrt(worn**2 + 2 * held**2 * lasting / life),
            }[kind]
            worn = np.maximum(worn, np.minimum(grown, held / edge))
        spins.append(drive / worn)
        before = drive
    return np.array(spins)


def _fitted(exchanges, kind):
    """Misfit, and the time, angle or work over the first resistance that doubles the resistance, and the edge."""
    times, torques, spins = _course(exchanges)
    slow = (spins > 0.3) & np.logical_and.accumulate(spins < 4.9)
    weights = spins[slow] ** 2 if slow.any() else np.ones(1)
    fresh = float((torques[slow] / spins[slow]) @ weights / weights.sum()) if slow.any() else torques[-1] / spins[-1]

    def off(p):
        model = _spins(kind, times, torques / (fresh * p[0]), abs(p[1]) * UNITS[kind], p[2])
        return (model - spins) / NOISE

    trials = [(1.0, life, edge) for life in np.geomspace(0.3, 5.0, 30) for edge in np.linspace(5.0, 6.5, 16)]
    sizes, lives, edges = np.array(trials).T
    models = _spins(kind, times, torques[:, None] / (fresh * sizes), lives * UNITS[kind], edges)
    costs = (((models - spins[:, None]) / NOISE) ** 2).sum(axis=0)
    best = None
    for start in np.argsort(costs)[:8]:
        found = least_squares(off, trials[start], diff_step=1e-4, max_nfev=25)
        if best is None or found.cost < best.cost:
            best = found
    return 2 * best.cost, abs(best.x[1]) * UNITS[kind], best.x[2]


def _spin(kind, life, edge):
    """The asked spin."""
    return float(_spins(kind, [AFTER_S], [FRESH], np.float64(life), np.float64(edge))[0])


def _best(exchanges):
    """The spin by the law that fits best."""
    fits = {kind: _fitted(exchanges, kind) for kind in KINDS}
    kind = min(fits, key=lambda name: fits[name][0])
    return _spin(kind, *fits[kind][1:])


def fit(readings, structure):
    """The spin with one kind of wear."""
    return _spin(structure, *_fitted(readings, structure)[1:])


def _load(number, kg, spans):
    """Load the pan with a ball instead of the one before, and read the spin after each span."""
    radius = (kg / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    where = [1.0 + 0.15 * (number % 2), 0.0, HEIGHT]
    made = call("create_objects", name=f"b{number}", pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    look = call("get_velocity", object_id="object_1")
    looks = [made for span in spans for made in (call("step", duration=span), look)]
    return [made, call("attach_objects", object1_id=f"b{number}", object2_id="object_2"), *old, *looks]


def solve(task):
    """Find the scale; then fast, slow and fast again, with loads that follow from the spins before."""
    seen, number, kg = [], 0, FIRST_KG
    while not seen or _course(seen)[2][-1] < SEEN:
        calls = _load(number, kg, [SETTLE_S])
        seen += zip(calls, (yield calls), strict=True)
        number, kg = number + 1, kg * GROWTH
    for goal, looks in PLAN:
        _, torques, spins = _course(seen)
        same = torques[-3:] == torques[-1]
        last = (spins[-3:] / torques[-3:])[same].mean()
        calls = _load(number, goal / last / ARM / GRAVITY, [LOOK_S] * looks)
        seen += zip(calls, (yield calls), strict=True)
        number += 1
    yield [answer(_best(seen))]


def batch(task):
    """Loads in even ratios, two looks at each, and the best fit."""
    calls = []
    for rung in range(8):
        calls += _load(rung, 0.004 * 2.6**rung, [8.0, 8.0])
    yield [answer(_best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Load it at once with much."""
    readings = yield _load(0, 20.0, [2.0])
    yield [answer(max(readings[-1]["angular_velocity"], 1.0))]


def structure(knobs):
    """With what the resistance grows."""
    return knobs["kind"]


def _life(knobs):
    return knobs["life"] * UNITS[knobs["kind"]]


def theory(knobs):
    """The spin by the drawn law."""
    return _spin(knobs["kind"], _life(knobs), knobs["edge"])


def measure(engine, knobs):
    """The engine's own fast run without the brake."""
    free = engine.changed({"body[trigger]/inertial.mass": 1e12})
    free.push("object_1", torque=np.array([0.0, 0.0, FRESH * knobs["scale"]]))
    free.step(free.whole_steps(AFTER_S))
    return float(free.turn("object_1").spin)


def naive(knobs):
    """The share of the spin that is lost in as long a run at 7 rad/s; no wear."""
    rates = {"time": 1.0, "turns": 7.0, "work": 49.0}
    return {"same share": FRESH / (1 + AFTER_S * rates[knobs["kind"]] / _life(knobs)), "no wear": FRESH}
