"""Scene 34: pump the wheel up, take angle, spin and work as points of its energy, fit weight and cords, predict."""

from math import pi, sqrt

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.protocol import answer, call

PAWL, TORQUE = 2.2, 0.13
ANGLE_ERROR, SPIN_ERROR = 0.0012, 0.003
REACH = 2.0
"""How far the pumping goes; a cord that is not known yet can only stop the wheel earlier."""
GRAVITY, LUMP_KG, LUMP_M = 9.81, 0.5, 0.4
CALLS, ITERATIONS, SINGLY = 148, 18, 4
"""At first half swings are planned one by one, then two at a time."""
LOOKS, FEW_LOOKS = (0.4, 0.7, 1.0), (1.0,)
"""When to look, in shares of a half swing: of a wide one, and of one that does not come so far."""
WIDE = 1.1
SLOW = 0.05
"""Below this spin the wheel counts as just turning back, in rad/s."""
NAMES = ("inertia", "weight", "kp", "from_plus", "km", "from_minus", "kt")
FREE = {"plus": (0, 1, 2, 3), "minus": (0, 1, 4, 5), "both": (0, 1, 2, 3, 4, 5), "torsion": (0, 1, 6)}
"""Which of the parameters a structure has; the others are 0."""
GUESS = np.array([0.13, 1.0, 1.8, 1.0, 1.8, 1.0, 0.7])
HIGHEST = np.array([2.0, 10.0, 20.0, 2.0, 20.0, 2.0, 10.0])


def _potential(p, angle):
    """Potential energy of weight, cords and torsion spring, in J."""
    angle = np.asarray(angle)
    return (
        p[1] * (1 - np.cos(angle))
        + p[2] * np.maximum(angle - p[3], 0) ** 2 / 2
        + p[4] * np.maximum(-angle - p[5], 0) ** 2 / 2
        + p[6] * angle**2 / 2
    )


def _slope(p, angle):
    return (_potential(p, angle + 1e-5) - _potential(p, angle - 1e-5)) / 2e-5


def _points(readings):
    """Angles, spins and the work of the torques up to there, with the torques and the doubt of the work."""
    place, torque, work, doubt, last = 0.0, 0.0, 0.0, 0.0, 0.0
    points = []
    for asked, got in readings:
        if asked.tool == "apply_torque":
            work += torque * (last - place)
            doubt += (ANGLE_ERROR * (asked.arguments["torque_vector"][1] - torque)) ** 2
            place, torque = last, asked.arguments["torque_vector"][1]
        elif asked.tool == "get_position":
            last = got["angle"]
        elif asked.tool == "get_velocity":
            points.append((last, got["angular_velocity"], work + torque * (last - place), torque, doubt))
        if abs(last) > PAWL:
            break
    kept = [point for point in points if abs(point[0]) <= PAWL]
    return np.array(kept or [(0.0, 0.0, 0.0, 0.0, 0.0)]).T


def _fitted(kind, readings):
    """Misfit and the parameters that fit the points best; errors of the work are carried on from turn to turn."""
    angle, spin, work, torque, doubt = _points(readings)
    free = list(FREE[kind])
    best = None
    for start in (0.8, 1.2):
        p = np.where(np.isin(np.arange(len(NAMES)), free), GUESS, 0.0)
        p[[3, 5]] = start
        for _ in range(2):
            alone = (p[0] * spin * SPIN_ERROR) ** 2 + ((_slope(p, angle) - torque) * ANGLE_ERROR) ** 2 + 1e-8
            white = np.linalg.inv(np.linalg.cholesky(np.minimum.outer(doubt, doubt) + np.diag(alone)))

            def off(q, white=white, p=p):
                full = p.copy()
                full[free] = q
                misfit = white @ (full[0] * spin**2 / 2 + _potential(full, angle) - work)
                return np.concatenate((misfit, (q - GUESS[free]) / (8 * GUESS[free])))

            got = least_squares(off, p[free], bounds=(0, HIGHEST[free]), x_scale=GUESS[free], max_nfev=40)
            p = p.copy()
            p[free] = np.clip(got.x, 1e-6, HIGHEST[free] - 1e-6)
        score = 2 * got.cost - 2 * float(np.sum(np.log(np.diag(white))))
        if best is None or score < best[0]:
            best = (score, p)
    return best


def _best(readings, kinds=tuple(FREE)):
    """The parameters of the structure that fits best, with a price for each parameter."""
    count = len(_points(readings)[0])
    fits = {kind: _fitted(kind, readings) for kind in kinds}
    kind = min(fits, key=lambda name: fits[name][0] + len(FREE[name]) * np.log(count))
    return fits[kind][1]


def _turn(p, energy, torque, start, side):
    """Where a wheel of this energy turns back on a side under a torque; the top if it gets there."""

    def left(angle):
        return energy + torque * angle - _potential(p, angle)

    grid = np.linspace(start, side * pi, 1001)
    free = left(grid)
    turns = np.nonzero((free[:-1] >= 0) & (free[1:] < 0))[0]
    if len(turns):
        return float(brentq(left, grid[turns[0]], grid[turns[0] + 1]))
    return start if free[-1] < 0 else side * pi


def _duration(p, energy, torque, start, end, count=400):
    """Time of the way between two angles; the substitution takes care of spins 0 at its ends."""
    edges = np.linspace(0, pi, count + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    angle = (start + end) / 2 - (end - start) / 2 * np.cos(middle)
    spin = np.sqrt(np.maximum(2 * (energy + torque * angle - _potential(p, angle)) / p[0], 1e-9))
    return float(np.sum(abs(end - start) / 2 * np.sin(middle) * (pi / count) / spin))


def _predict(p):
    """Least spins at the bottom, to the top on either side, with the lump."""
    lump = 2 * LUMP_KG * GRAVITY * LUMP_M
    inertia = p[0] + LUMP_KG * LUMP_M**2
    return [sqrt(2 * (float(_potential(p, side * pi)) + lump) / inertia) for side in (1, -1)]


def _twist(torque):
    return call("apply_torque", object_id="object_1", torque_vector=[0, round(torque, 4), 0])


def _look(length):
    return [
        call("step", duration=max(round(length / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def _half_swing(p, angle, spin):
    """Turn along the motion up to the next turning place, or as much as the reach allows; looks on the way."""
    side = 1 if spin > 0 else -1
    for share in (1.0, 0.7, 0.4, 0.2, 0.0, -0.3, -0.6, -1.0):
        torque = side * TORQUE * share
        energy = p[0] * spin**2 / 2 + float(_potential(p, angle)) - torque * angle
        end = _turn(p, energy, torque, angle, side)
        if abs(end) <= REACH:
            break
    total = _duration(p, energy, torque, angle, end)
    calls, before = [_twist(torque)], 0.0
    for share in LOOKS if abs(end) > WIDE else FEW_LOOKS:
        calls += _look(total * share - before)
        before += max(round((total * share - before) / 0.005), 1) * 0.005
    return calls, end


def solve(task):
    """A torque to begin with, then half swings whose lengths the model so far predicts."""
    calls = [_twist(TORQUE)]
    for length in (0.15, 0.15, 0.15, 0.2):
        calls += _look(length)
    seen = list(zip(calls, (yield calls), strict=True))
    for iteration in range(ITERATIONS):
        p = _best(seen, ("both", "torsion"))
        angle, spin = seen[-2][1]["angle"], seen[-1][1]["angular_velocity"]
        if abs(spin) < SLOW:
            spin = -SLOW if angle > 0 else SLOW
        calls = []
        for _ in range(1 if iteration < SINGLY else 2):
            more, angle = _half_swing(p, angle, spin)
            calls, spin = calls + more, -1e-3 if angle > 0 else 1e-3
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(_best(seen)))]


def fit(readings, structure):
    """Both spins by the cords or the spring of a structure."""
    return _predict(_fitted(structure, readings)[1])


def structure(knobs):
    """Which cords there are, or a torsion spring."""
    return knobs["kind"]


def _true(knobs):
    return np.array([knobs[name] for name in NAMES], dtype=float)


def naive(knobs):
    """Weight alone; weight and inertia of the lump left out; the side with less taken for both."""
    p = _true(knobs)
    small = 2 * sqrt((p[1] + p[6] + LUMP_KG * GRAVITY * LUMP_M) / (p[0] + LUMP_KG * LUMP_M**2))
    alone = [sqrt(2 * float(_potential(p, side * pi)) / p[0]) for side in (1, -1)]
    return {"pendulum of small swings": [small, small], "without the lump": alone}


def stage(task):
    """Turn as hard as possible for long and take the greatest spin."""
    calls = [_twist(TORQUE)]
    for _ in range(8):
        calls += _look(0.3)
    readings = yield calls
    spins = [abs(reading["angular_velocity"]) for reading in readings if "velocity" in reading]
    yield [answer([max(spins), max(spins)])]


def batch(task):
    """Torques to and fro with a usual period, looked at evenly."""
    calls = []
    for number in range(6):
        calls += [_twist(TORQUE * (-1) ** number), *_look(0.3), *_look(0.3), *_look(0.3)]
    readings = yield calls
    yield [answer(_predict(_best(list(zip(calls, readings, strict=True)))))]


def theory(knobs):
    """The energy at the top over the inertia, with the lump."""
    return _predict(_true(knobs))


def measure(engine, knobs):
    """With the lump and without the pawl: held near the top on either side, let go, spin at the bottom."""
    p = _true(knobs)
    mass = knobs["mass"] + LUMP_KG
    depth = (knobs["weight"] / GRAVITY + LUMP_KG * LUMP_M) / mass
    own = knobs["inertia"] + LUMP_KG * LUMP_M**2 - mass * depth**2
    changes = {
        "body[pawl].pos": (0.0, 0.0, 0.0),
        "body[object_1]/inertial.mass": mass,
        "body[object_1]/inertial.pos": (0.0, 0.0, -depth),
        "body[object_1]/inertial.diaginertia": (own, own, own),
    }
    spins = []
    for side in (1, -1):
        free = engine.changed(changes)
        held = float(_slope(p, side * pi))
        top = side * (pi if abs(held) > SLOW else pi - 0.02)
        for _ in range(free.whole_steps(6.0)):
            now = free.turn("object_1")
            free.push("object_1", torque=np.array([0.0, held + 60 * (top - now.angle) - 10 * now.spin, 0.0]))
            free.step(1)
        free.push("object_1", torque=np.zeros(3))
        before = now = free.turn("object_1")
        while now.angle * side > 0:
            free.step(1)
            before, now = now, free.turn("object_1")
        share = before.angle / (before.angle - now.angle)
        spins.append(abs(before.spin + share * (now.spin - before.spin)))
    return spins
