"""Scene 28: pump the glider up, take place, speed and work as points of its potential, fit cords, integrate."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import force, position, velocity
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.works import cheapest, parts_of_way, refitted, weighed, whitening, work_points

LATCH, FORCE, START = 1.1, 1.5, 2.0
PLACE_ERROR, SPEED_ERROR = 0.0007, 0.0018
REACH = 0.93
"""How far the pumping goes; a cord that is not known yet can only stop the glider earlier."""
CALLS, ITERATIONS, SINGLY = 148, 18, 5
"""At first half swings are planned one by one, then two at a time."""
LOOKS = (0.3, 0.6, 0.85, 1.0)
"""When to look, in shares of a half swing."""
SLOW = 0.05
"""Below this speed the glider counts as just turning, in m/s."""
NAMES = ("f0", "k_right", "gr", "sr", "far_right", "k_left", "gl", "sl", "far_left")
FREE = {"left": (1, 2, 5, 6, 7, 8), "right": (1, 2, 3, 4, 5, 6), "both": (1, 2, 3, 4, 5, 6, 7, 8), "tight": (0, 1, 5)}
"""Which of the parameters a structure has; the others are 0."""
GUESS = np.array([0.5, 6.0, 0.05, 15.0, 0.5, 6.0, 0.05, 15.0, 0.5])
HIGHEST = np.array([3.0, 60.0, 0.3, 120.0, 0.7, 60.0, 0.3, 120.0, 0.7])


RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)])


def _potential(p, x):
    """Potential energy of all cords at places x, in J."""
    x = np.asarray(x)
    out, left = np.maximum(x, 0), np.maximum(-x, 0)
    return (
        p[0] * np.abs(x)
        + p[1] * np.maximum(out - p[2], 0) ** 2 / 2
        + p[3] * np.maximum(out - p[4], 0) ** 2 / 2
        + p[5] * np.maximum(left - p[6], 0) ** 2 / 2
        + p[7] * np.maximum(left - p[8], 0) ** 2 / 2
    )


def _slope(p, x):
    return (_potential(p, x + 1e-5) - _potential(p, x - 1e-5)) / 2e-5


def _points(readings):
    """Places and potential energies from place, speed and the work of the pushes, with their errors."""
    place, speed, work, force, doubt = work_points(readings, RIG, PLACE_ERROR, LATCH)
    return place, work - speed**2 / 2, speed, force, doubt


def _variances(p, x, speed, force):
    """Variance of each point by itself, in J²."""
    return (speed * SPEED_ERROR) ** 2 + ((_slope(p, x) - force) * PLACE_ERROR) ** 2 + 1e-6


def _fitted(kind, readings):
    """Misfit and the parameters that fit the points best; errors of the work are carried on from push to push."""
    x, energy, speed, force, doubt = _points(readings)
    free = list(FREE[kind])
    best = None

    def alone(p):
        return _variances(p, x, speed, force)

    def misfits(p):
        return _potential(p, x) - energy, []

    p = np.where(np.isin(np.arange(len(NAMES)), free), GUESS, 0.0)
    for far in (0.38, 0.5, 0.62):
        p = p.copy()
        p[[4, 8]] = far
        high = HIGHEST[free]
        cost, p, log = refitted(p, free, doubt, alone, misfits, GUESS[free], high + 1e-9, (1e-9, high))
        if best is None or cost < best[0]:
            best = (cost, p)
    return 2 * best[0] - 2 * log, best[1]


def _best(readings, kinds=tuple(FREE)):
    """The structure that fits best, with a price for each parameter."""
    fits = {kind: _fitted(kind, readings) for kind in kinds}
    return cheapest(fits, FREE, len(_points(readings)[0]))


def _turn(p, energy, force, side):
    """Where a glider of this energy turns on a side under a force."""

    def left(x):
        return energy + force * x - _potential(p, x)

    grid = side * np.linspace(-6, 6, 2401)
    free = left(grid)
    turns = np.nonzero((free[:-1] >= 0) & (free[1:] < 0))[0]
    if not len(turns):
        return float(grid[np.argmax(free)])
    return float(brentq(left, grid[turns[-1]], grid[turns[-1] + 1]))


def _between(p, energy, force, start, end, count=400):
    """Times and places of the way between two places; the substitution takes care of speeds 0 at its ends."""

    def speed_at(x):
        return np.sqrt(np.maximum(2 * (energy + force * x - _potential(p, x)), 1e-9))

    parts, x = parts_of_way(speed_at, start, end, count)
    return np.cumsum(parts), x


def _predict(p):
    """Farthest place on the other side, and time of a full swing."""
    energy = float(_potential(p, START))
    other = _turn(p, energy, 0.0, -1)
    return [other, 2 * float(_between(p, energy, 0.0, START, other, 4000)[0][-1])]


def _half_swing(p, x, v):
    """Push along the velocity up to the next turn, or as much as the reach allows; looks on the way."""
    side = 1 if v > 0 else -1
    force = side * FORCE
    for share in (1.0, 0.7, 0.4, 0.2, 0.0, -0.3, -0.6, -1.0):
        force = side * FORCE * share
        energy = v**2 / 2 + float(_potential(p, x)) - force * x
        end = _turn(p, energy, force, side)
        if abs(end) <= REACH:
            break
    times, _ = _between(p, energy, force, x, end)
    total = float(times[-1])
    return RIG.along(force, (total * share for share in LOOKS)), end


def _swing_on(p, x, v, count):
    """Several half swings, each planned from where the model says that the one before ends."""
    calls = []
    for _ in range(count):
        more, x = _half_swing(p, x, v)
        calls += more
        v = -1e-3 if x > 0 else 1e-3
    return calls


def solve(task):
    """One push to begin with, then half swings whose lengths the model so far predicts."""
    calls = RIG.leg(FORCE, 0.4, looks=4)
    seen = list(zip(calls, (yield calls), strict=True))
    for iteration in range(ITERATIONS):
        _, p = _best(seen, ("both", "tight"))
        x, v = seen[-2][1]["position"][0], seen[-1][1]["velocity"][0]
        if abs(v) < SLOW:
            v = -SLOW if x > 0 else SLOW
        calls = _swing_on(p, x, v, 1 if iteration < SINGLY else 2)
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    _, p = _best(seen)
    yield [answer(_predict(p))]


def fit(readings, structure):
    """Both numbers by the cords of a structure."""
    return _predict(_fitted(structure, readings)[1])


def rivals(readings):
    """The cords of each structure, fitted with the errors that follow from the best of them."""
    x, energy, speed, force, doubt = _points(readings)
    fits = {kind: _fitted(kind, readings) for kind in FREE}
    _, best = cheapest(fits, FREE, len(x))
    return weighed(
        {kind: p for kind, (_, p) in fits.items()},
        FREE,
        whitening(doubt, _variances(best, x, speed, force)),
        lambda p: _potential(p, x) - energy,
        _predict,
        HIGHEST,
    )


def _true(knobs):
    return np.array([knobs[name] for name in NAMES], dtype=float)


def naive(knobs):
    """The same on both sides; a single spring as stiff as near the middle."""
    p = _true(knobs)
    small = [p[0], p[1], p[2], 0, 0, p[5], p[6], 0, 0]
    half = float(_between(p, float(_potential(p, START)), 0.0, START, 0.0, 2000)[0][-1])
    largest = -_turn(p, float(_potential(p, 1.0)), 0.0, -1) * START
    swing = 2 * float(_between(p, float(_potential(p, 1.0)), 0.0, 1.0, -largest / START, 2000)[0][-1])
    return {
        "same on both sides": [-START, 4 * half],
        "cords of the middle": [*_predict(np.array(small))],
        "largest swing": [-largest, swing],
    }


def stage(task):
    """Push as hard as possible to come to 2.00 m."""
    readings = yield RIG.leg(FORCE, 4.0, looks=2)
    x = [reading["position"][0] for reading in readings if "position" in reading]
    yield [answer([-abs(x[-1]) - 1.0, 2.0])]


def batch(task):
    """Pushes to and fro with a usual period, looked at evenly."""
    calls = [asked for number in range(6) for asked in RIG.leg(FORCE * (-1) ** number, 0.75, looks=3)]
    readings = yield calls
    _, p = _best(list(zip(calls, readings, strict=True)))
    yield [answer(_predict(p))]


def theory(knobs):
    """Energy gives the place, an integral the time."""
    return _predict(_true(knobs))


def measure(engine, knobs):
    """The swing in the engine, without latches."""
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0)})
    free.place("object_1", np.array([START, 0.0, 0.5]), {})
    times, speeds, places, tick = [0.0], [0.0], [START], 1 / free.whole_steps(1.0)
    while len(times) < 3 or not (speeds[-2] > 0 >= speeds[-1]):
        free.step(1)
        times.append(times[-1] + tick)
        speeds.append(float(free.twist("object_1").linear[0]))
        places.append(float(free.pose("object_1").position[0]))
    share = speeds[-2] / (speeds[-2] - speeds[-1])
    return [min(places), times[-2] + share * tick]
