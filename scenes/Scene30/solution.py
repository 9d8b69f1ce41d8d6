"""Scene 30: swing wider little by little, fit mass and potential to place, speed and work, find the humps."""

from math import sqrt

import numpy as np
from scipy.optimize import least_squares

from scenes.courses import force, position, velocity
from scenes.family import member
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.works import parts_of_way, whitening, work_points

FORCE, BLOCK_KG = 0.6, 8.0
PLACE_ERROR, SPEED_ERROR = 0.0005, 0.0012
UNIT = 0.8
"""The potential is a polynomial of x over this many metres, from the second power on."""
POWERS = np.arange(2, 8)
NEAREST, FARTHEST, STEP, NEAR_TOP = 0.38, 1.05, 0.13, 0.9
"""Humps lie between; how much wider a swing may become; which share of the way to a hump is enough."""
CALLS, LAB_S, ITERATIONS = 148, 33.0, 18
LOOKS, FEW_LOOKS, WIDE = (0.35, 0.7, 1.0), (0.5, 1.0), 0.35
"""When to look, in shares of a half swing: of a wide one, and of one that does not come so far."""
UNKNOWN = 0.12
"""A side on which the carriage has not come farther, in m, is taken for a mirror image of the other."""
LOWER = 0.75
"""The lower hump asks for less than this share of the energy of the other one."""
FLAT = {"left": 0, "right": 0, "flat": 2}
"""Powers of the place by which the force of a kind of hollow has more."""
TURNED = 0.03
"""Nearer to its turning place than this, in m, the carriage counts as turning back."""


RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)])


def _potential(p, x):
    return np.power.outer(np.asarray(x) / UNIT, POWERS) @ p[1:]


def _slope(p, x):
    return np.power.outer(np.asarray(x) / UNIT, POWERS - 1) @ (POWERS * p[1:]) / UNIT


def _fitted(readings):
    """Mass and polynomial of the potential; high powers are held near zero until the points ask for them."""
    x, speed, work, force, doubt = work_points(readings, RIG, PLACE_ERROR, FARTHEST)
    p = np.array([1.5, 1.5, *np.zeros(len(POWERS) - 1)])
    held = np.array([3.0, *np.full(len(POWERS), 6.0)])
    for _ in range(3):
        alone = (p[0] * speed * SPEED_ERROR) ** 2 + ((_slope(p, x) - force) * PLACE_ERROR) ** 2 + 1e-8
        white = whitening(doubt, alone)
        rows = np.column_stack([speed**2 / 2, np.power.outer(x / UNIT, POWERS)])
        full = np.vstack([white @ rows, np.diag(1 / held)])
        start = np.array([1.5, *np.zeros(len(POWERS))])
        p = np.linalg.lstsq(full, np.concatenate([white @ work, start / held]), rcond=None)[0]
        p[0] = max(p[0], 0.1)
    return p


def _top(p, side):
    """Place of the hump on a side: where the slope first falls to zero."""
    x = side * np.linspace(0.3, FARTHEST, 751)
    falling = np.nonzero(side * _slope(p, x) <= 0)[0]
    return float(x[falling[0]]) if len(falling) else side * FARTHEST


def _predict(p, sides=(-1, 1)):
    """Least speed with the block, and greatest slope, over the humps of these sides."""
    tops = [_top(p, side) for side in sides]
    energy = min(float(_potential(p, top)) for top in tops)
    slopes = [float(np.max(np.abs(_slope(p, np.linspace(0, top, 500))))) for top in tops]
    return [sqrt(2 * max(energy, 0) / (p[0] + BLOCK_KG)), min(slopes)]


def _turn(p, energy, force, start, side):
    """Where a carriage of this energy turns back on a side under a force; the farthest place if it does not."""
    grid = np.linspace(start, side * FARTHEST, 801)
    free = energy + force * grid - _potential(p, grid)
    turns = np.nonzero((free[:-1] >= 0) & (free[1:] < 0))[0]
    if len(turns):
        n = turns[0]
        return float(grid[n] + (grid[n + 1] - grid[n]) * free[n] / (free[n] - free[n + 1]))
    return start if free[-1] < 0 else side * FARTHEST


def _duration(p, energy, force, start, end):
    """Time of the way between two places."""

    def speed_at(x):
        return np.sqrt(np.maximum(2 * (energy + force * x - _potential(p, x)) / p[0], 1e-8))

    return float(np.sum(parts_of_way(speed_at, start, end)[0]))


def _half_swing(p, x, speed, explored):
    """Push along the motion up to the next turning place, as far as the swing may widen; looks on the way."""
    side = 1 if speed > 0 else -1
    still = _turn(p, p[0] * speed**2 / 2 + float(_potential(p, x)), 0.0, x, side)
    if abs(still - x) < TURNED and side * x > 0:
        side, speed = -side, 0.0
    if explored[side] < UNKNOWN:
        p = np.array([p[0], *p[1:] * (-1.0) ** POWERS])
    allowed = min(max(explored[side] + STEP, NEAREST), NEAR_TOP * abs(_top(p, side)) + 0.01)
    for share in (1.0, 0.7, 0.4, 0.2, 0.0, -0.3, -0.6, -1.0):
        force = side * FORCE * share
        energy = p[0] * speed**2 / 2 + float(_potential(p, x)) - force * x
        end = _turn(p, energy, force, x, side)
        if abs(end) <= allowed:
            break
    total = min(_duration(p, energy, force, x, end), 8.0)
    return RIG.along(force, (total * share for share in (LOOKS if abs(end) > WIDE else FEW_LOOKS)))


def solve(task):
    """A push to begin with, then half swings whose lengths and forces the fit so far tells."""
    calls = RIG.along(FORCE, (0.2, 0.4, 0.7, 1.0))
    seen = list(zip(calls, (yield calls), strict=True))
    for _ in range(ITERATIONS):
        p, places = _fitted(seen), work_points(seen, RIG, PLACE_ERROR, FARTHEST)[0]
        x, speed = seen[-2][1]["position"][0], seen[-1][1]["velocity"][0]
        calls = _half_swing(p, x, speed, {1: np.max(places), -1: -np.min(places)})
        lasting = sum(asked.arguments.get("duration", 0) for asked in calls)
        if len(seen) + len(calls) > CALLS or seen[-1][1]["sim_time"] + lasting > LAB_S:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(_fitted(seen)))]


def fit(readings, structure):
    """Both numbers, for the hump that is the lower one in a structure."""
    p = _fitted(readings)
    return [_predict(p, (-1,) if structure == "left" else (1,))[0], _predict(p)[1]]


def _law(power, mass, height, left, right, lean):
    """Mass and polynomial of the law, and the logarithm of the energy at the left hump over that at the right one."""
    factors = [left * right, right - left + lean * left * right, lean * (right - left) - 1, -lean]
    p = np.zeros(1 + len(POWERS))
    for number, factor in enumerate(factors):
        n = number + power
        p[1 + n] = factor / (n + 2) * UNIT ** (n + 2)
    energies = _potential(p, -left), _potential(p, right)
    p *= height / min(energies)
    p[0] = mass
    return p, float(np.log(energies[0] / energies[1]))


def _misfits(kind, readings):
    """Logarithms of mass and height, places of the humps and lean → misfits of the energies, in their errors."""
    x, speed, work, force, doubt = work_points(readings, RIG, PLACE_ERROR, FARTHEST)
    p = _fitted(readings)
    alone = (p[0] * speed * SPEED_ERROR) ** 2 + ((_slope(p, x) - force) * PLACE_ERROR) ** 2 + 1e-8
    white = whitening(doubt, alone)
    rows = np.column_stack([speed**2 / 2, np.power.outer(x / UNIT, POWERS)])

    def misfits(constants):
        law, ratio = _law(FLAT[kind], *np.exp(constants[:2]), *constants[2:])
        higher = np.log(LOWER) + (ratio if kind == "left" else -ratio)
        return np.append(white @ (rows @ law - work), max(higher, 0.0) / 1e-3)

    return misfits, p


def rivals(readings):
    """Each law with each lower hump, fitted."""
    found = {}
    for kind, power in FLAT.items():
        misfits, p = _misfits(kind, readings)
        mass, height = np.log(p[0]), np.log(max(float(_potential(p, _top(p, 1))), 0.3))
        edges = [(mass - 1, mass + 1), (-1.5, 2.5), (0.4, 1.0), (0.4, 1.0), (-0.6, 0.6)]
        best = None
        for left, right in ((0.55, 0.8), (0.7, 0.7), (0.8, 0.55)):
            start = np.clip([mass, height, left, right, 0.0], *np.array(edges).T)
            got = least_squares(misfits, start, bounds=np.array(edges).T, max_nfev=100)
            best = got if best is None or got.cost < best.cost else best
        found[kind] = member(
            misfits,
            lambda constants, power=power: _predict(_law(power, *np.exp(constants[:2]), *constants[2:])[0]),
            best.x,
            edges,
        )
    return found


def _true(knobs):
    places = knobs["left"], knobs["right"], knobs["lean"]
    return _law(int(knobs["e"]), knobs["mass"], knobs["height"], *places)[0]


def naive(knobs):
    """The speed without the block; the law of the middle carried on to the nearer hump."""
    p = _true(knobs)
    bare = _predict(p)[0] * sqrt((p[0] + BLOCK_KG) / p[0])
    middle = max(float(_slope(p, 0.1)) / 0.1, 0.0)
    far = min(knobs["left"], knobs["right"])
    return {
        "without the block": [bare, _predict(p)[1]],
        "parabola of the hollow": [sqrt(middle * far**2 / (p[0] + BLOCK_KG)), middle * far],
    }


def stage(task):
    """Push as hard as possible and read speed and force."""
    readings = yield RIG.leg(FORCE, 3.2, looks=8)
    speeds = [abs(reading["velocity"][0]) for reading in readings if "velocity" in reading]
    yield [answer([max(speeds), FORCE])]


def batch(task):
    """Pushes to and fro with a usual period, looked at evenly."""
    calls = [asked for number in range(6) for asked in RIG.leg(FORCE * (-1) ** number, 1.2, looks=3)]
    readings = yield calls
    yield [answer(_predict(_fitted(list(zip(calls, readings, strict=True)))))]


def theory(knobs):
    """Energy at the lower hump over the mass with the block; the greatest slope."""
    return _predict(_true(knobs))


def measure(engine, knobs):
    """With the block: let go just inside each hump and read in the hollow; the force of the magnets at many places."""
    speeds, forces = [], []
    for side, hump in ((-1, knobs["left"]), (1, knobs["right"])):
        free = engine.changed({"body[object_1]/inertial.mass": knobs["mass"] + BLOCK_KG})
        free.place("object_1", np.array([side * (hump - 0.004), 0.0, 0.5]), {})
        now = side * (hump - 0.004)
        while now * side > 0:
            free.step(1)
            now = float(free.pose("object_1").position[0])
        speeds.append(float(abs(free.twist("object_1").linear[0])))
        slope = []
        for share in np.linspace(0.02, 0.98, 97):
            free.place("object_1", np.array([side * hump * share, 0.0, 0.5]), {})
            began = float(free.twist("object_1").linear[0])
            free.step(1)
            gained = float(free.twist("object_1").linear[0]) - began
            slope.append(abs(gained) * free.whole_steps(1.0) * (knobs["mass"] + BLOCK_KG))
        forces.append(max(slope))
    return [min(speeds), min(forces)]
