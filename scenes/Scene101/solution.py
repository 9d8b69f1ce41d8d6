"""Scene 101: turn the wheel for a long time, fast and slowly, and find out on what the wear of its bearing depends."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, dense_ball, hung, joined
from scenes.protocol import answer, call

PAN = "object_2"
ARM, BRAKE = 0.1, 10.0
FRESH, AFTER_S = 25.0, 60.0
"""Spin at which the fresh bearing would take up the asked torque, rad/s; time until then."""
DENSITY, HEIGHT = 1e5, 1.0
UNITS = {"time": 100.0, "turns": 700.0, "work": 9800.0}
"""Time, angle, or work over the first resistance, after which the resistance has doubled, about."""
KINDS = tuple(UNITS)
LOW, HIGH = (0.9, 0.2, 5.0), (1.1, 8.0, 6.5)
"""Ranges of the first resistance over its unit, of what doubles it over its unit, and of the edge, rad/s."""
NOISE = 0.025
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.001, 8.0, 0.45, 3.0
PLAN = ((4.5, 3), (9.2, 4), (9.3, 4), (7.0, 5), (9.3, 4), (7.0, 5), (9.3, 4), (4.5, 3), (9.3, 4))
"""Spins that are aimed at, and how many looks there are at each."""
LOOK_S = 4.0
LAG_S = 0.35
"""How late the wheel follows a new load, about: the pan sinks and the wheel gathers speed."""


def _course(exchanges):
    """Torques and spins, until the brake stops the wheel."""
    legs = []
    for asked, reading, load in hung(exchanges):
        if asked.tool == "step":
            legs.append([asked.arguments["duration"], ARM * load[PAN] * GRAVITY, np.nan])
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


def _misfits(exchanges, kind):
    """Misfits of the spins, as a function of the first resistance, of what doubles it, both in units, and of the edge.

    The first unit is the resistance before anything was worn.
    """
    times, torques, spins = _course(exchanges)
    slow = (spins > 0.3) & np.logical_and.accumulate(spins < 4.9)
    weights = spins[slow] ** 2 if slow.any() else np.ones(1)
    fresh = float((torques[slow] / spins[slow]) @ weights / weights.sum()) if slow.any() else torques[-1] / spins[-1]

    def off(sizes, lives, edges):
        """For numbers, or for arrays of trials."""
        drives = torques.reshape(-1, *(1 for _ in np.shape(sizes))) / (fresh * sizes)
        model = _spins(kind, times, drives, lives * UNITS[kind], edges)
        return (model - spins.reshape(-1, *(1 for _ in np.shape(sizes)))) / NOISE

    return off


def _fitted(exchanges, kind):
    """The constants of `_misfits` that fit best, and their chi-square."""
    off = _misfits(exchanges, kind)
    trials = [(1.0, life, edge) for life in np.geomspace(0.3, 5.0, 30) for edge in np.linspace(5.0, 6.5, 16)]
    costs = (off(*np.array(trials).T) ** 2).sum(axis=0)
    best = None
    for start in np.argsort(costs)[:8]:
        found = least_squares(
            lambda p: off(p[0], p[1], np.float64(p[2])), trials[start], bounds=(LOW, HIGH), diff_step=1e-4, max_nfev=25
        )
        if best is None or found.cost < best.cost:
            best = found
    return best.x, 2 * best.cost


def rivals(readings):
    """Each kind of wear, fitted."""

    def of(kind):
        off = _misfits(readings, kind)
        return member(
            lambda p: off(p[0], p[1], np.float64(p[2])),
            lambda p: _spin(kind, p[1] * UNITS[kind], p[2]),
            _fitted(readings, kind)[0],
            list(zip(LOW, HIGH, strict=True)),
        )

    return {kind: of(kind) for kind in KINDS}


def _spin(kind, life, edge):
    """The asked spin."""
    return float(_spins(kind, [AFTER_S], [FRESH], np.float64(life), np.float64(edge))[0])


def fit(readings, structure):
    """The spin with one kind of wear."""
    _, life, edge = _fitted(readings, structure)[0]
    return _spin(structure, life * UNITS[structure], edge)


def _best(exchanges):
    """The spin by the law that fits best."""
    return fit(exchanges, min(KINDS, key=lambda kind: _fitted(exchanges, kind)[1]))


def _load(number, kg, spans):
    """Load the pan with a ball instead of the one before, and read the spin after each span."""
    where = [1.0 + 0.15 * (number % 2), 0.0, HEIGHT]
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    look = call("get_velocity", object_id="object_1")
    looks = [made for span in spans for made in (call("step", duration=span), look)]
    return [*joined(dense_ball(f"b{number}", kg, where, DENSITY), PAN), *old, *looks]


def solve(task):
    """Find the size of the torques; then turn fast, slowly and fast again, with loads computed from earlier speeds."""
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
