"""Scene 102: take out the pins, load both pans step by step, and carry the laws of the springs on to the energy."""

from scenes.loads import GRAVITY, dense_ball, hung, joined
from scenes.protocol import answer, call
from scenes.springs import best, drawn, drawn_kinds, energy, fitted, members, next_load

structure = drawn_kinds
TOP_M, CATCH_M, FAR_M = 2.0, 0.3, 0.9
PANS = {"object_1": -0.3, "object_2": 0.3}
"""Pans, and where they stand along x, m."""
PINS = ("object_3", "object_4")
DENSITY, FIRST_KG, WAIT_S, TURNS = 1e5, 0.004, 6.0, 14
SIGMA = 8e-5
"""Standard deviation of a compression: of its resolution, and of what is missing to rest, m."""
ALONE = 30.0
"""Stiffness of a spring of which too little is known, N/m."""


def _work(laws):
    """Energy of both springs at the far compression."""
    return sum(energy(FAR_M, *law) for law in laws)


def _points(exchanges):
    """Compressions and forces of both springs, ascending."""
    points = {pan: [] for pan in PANS}
    for asked, reading, load in hung(exchanges):
        if asked.tool == "get_position":
            pan, way = asked.arguments["object_id"], TOP_M - reading["position"][2]
            if 0.002 < way < CATCH_M:
                points[pan].append((way, GRAVITY * load[pan]))
    return [sorted(own) for own in points.values()]


def _best(exchanges):
    """The work by the kinds that fit best."""
    return _work([best(own, ALONE) for own in _points(exchanges)])


def fit(readings, structure):
    """The work by springs of these kinds."""
    return _work([fitted(own, kind)[1] for own, kind in zip(_points(readings), structure.split(", "), strict=True)])


def rivals(readings):
    """Springs of all kinds, fitted."""
    return members(_points(readings), _work, SIGMA)


def _unpinned():
    return [call("delete_objects", object_id=pin) for pin in PINS]


def _loaded(number, masses):
    """Put ball `number` on each of some pans, instead of the one before; wait, and read where they are."""
    calls = []
    for pan, kg in masses.items():
        where = [PANS[pan], 0.3 * (number % 2) - 0.15, TOP_M]
        calls += joined(dense_ball(f"ball{pan[-1]}_{number}", kg, where, DENSITY), pan)
        calls += [call("delete_objects", object_id=f"ball{pan[-1]}_{number - 1}")] if number else []
    return [*calls, call("step", duration=WAIT_S), *(call("get_position", object_id=pan) for pan in masses)]


def solve(task):
    """Replace the ball on each pan by a heavier one, again and again; each follows from where the pan is."""
    exchanges, masses, rows = [], dict.fromkeys(PANS, FIRST_KG), {pan: [(0.0, 0.0)] for pan in PANS}
    for number in range(TURNS):
        calls = [*([] if number else _unpinned()), *_loaded(number, masses)]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        for pan, reading in zip(tuple(masses), readings[-len(masses) :], strict=True):
            rows[pan].append((TOP_M - reading["position"][2], GRAVITY * masses[pan]))
            following = next_load(rows[pan])
            if following is None:
                del masses[pan]
            else:
                masses[pan] = max(following[1] / GRAVITY, 1.01 * masses[pan])
        if not masses:
            break
    yield [answer(_best(exchanges))]


def batch(task):
    """Six loads in even ratios on each pan, and the best fit."""
    calls = _unpinned()
    for number in range(6):
        calls += _loaded(number, dict.fromkeys(PANS, 0.05 * 2000 ** (number / 5)))
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Load one spring a little, and carry its energy over with the square of the compression."""
    readings = yield [*_unpinned(), *_loaded(0, {"object_1": FIRST_KG})]
    way = max(TOP_M - readings[-1]["position"][2], 1e-3)
    yield [answer(_work([(GRAVITY * FIRST_KG / way,)] * 2))]


def naive(knobs):
    """The stiffnesses at small compressions."""
    return {"stiffness at small compressions": _work([(knobs["k1"],), (knobs["k2"],)])}


def theory(knobs):
    """Energy of both springs."""
    return _work([drawn(knobs, 1), drawn(knobs, 2)])


def measure(engine, knobs):
    """Energies of the springs from the speeds that they give to the engine's pans, made heavy, when they let go."""
    kg, energies = 50.0, 0.0
    for number, (pan, pin) in enumerate(zip(PANS, PINS, strict=True), 1):
        changes = {f"body[{pan}]/inertial.mass": kg, f"joint[guide{number}].damping": 0.0}
        changes |= {f"joint[guide{number}].range": (-5.0, 5.0), f"joint[trigger{number}_joint].damping": 1e9}
        free = engine.changed(changes)
        free.remove(pin)
        where = free.pose(pan).position.copy()
        where[2] = TOP_M - FAR_M
        free.place(pan, where, {})
        speed = 0.0
        while free.pose(pan).position[2] < TOP_M:
            free.step(1)
            speed = max(speed, float(free.twist(pan).linear[2]))
        energies += kg * speed**2 / 2
    return energies
