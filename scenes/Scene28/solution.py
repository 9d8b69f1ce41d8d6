"""Scene 28: pump the glider up, take place, speed and work as points of its potential, fit cords, integrate."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import force, position, velocity
from scenes.protocol import answer
from scenes.pumping import Pump
from scenes.rigs import Rig
from scenes.works import cheapest, guesses, parts_of_way, refitted, weighed, whitening, work_points

LATCH, FORCE, START = 1.1, 1.5, 2.0
PLACE_ERROR, SPEED_ERROR = 0.0007, 0.0018
REACH, MEMBERS, EXCLUDED = 1.06, 20, 16.0
"""How far the pumping may go, by so many plausible potentials of each structure, and the chi-square above the least
one from which a structure is excluded."""
LOOKS, FEW_LOOKS = (0.12, 0.3, 0.6, 0.78, 0.9, 1.0), (0.4, 0.7, 1.0)
"""When to look, in shares of a half swing: of one past all rings, and of one that does not come so far."""
RINGS = 0.7
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


def _looks(end):
    return LOOKS if abs(end) > RINGS else FEW_LOOKS


PUMP = Pump(RIG, _potential, lambda p: np.ones_like(p[0]), FORCE, REACH, _looks, calls=148, time_s=11.9, singly=6)


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
    """The fit of a structure to the points; errors of the work are carried on from push to push."""
    x, energy, speed, force, doubt = _points(readings)
    free = list(FREE[kind])

    def alone(p):
        return _variances(p, x, speed, force)

    def misfits(p):
        return _potential(p, x) - energy, []

    starts = guesses(GUESS, free, (4, 8), (0.38, 0.5, 0.62))
    return refitted(starts, free, doubt, alone, misfits, GUESS, HIGHEST, 1e-9)


def _fits(readings):
    """The fit of each structure."""
    return {kind: _fitted(kind, readings) for kind in FREE}


def _best(readings):
    """The fit of the best structure, with a price for each parameter."""
    return cheapest(_fits(readings), len(_points(readings)[0]))


def _plausible(readings):
    """Constants of every structure that the points allow, the best first.

    Draws of a structure with a second cord have one of some stiffness. Those without it are needed as well: the glider
    comes farthest with them, and no point excludes them before the glider has been there.
    """
    fits = _fits(readings)
    best = cheapest(fits, len(_points(readings)[0]))
    most = min(fit.chi_square for fit in fits.values()) + EXCLUDED
    others = [fit for fit in fits.values() if fit is not best and fit.chi_square <= most]
    return np.column_stack([fit.plausible(MEMBERS) for fit in (best, *others)])


def _turn(p, energy):
    """The farthest place on the left of a glider of this energy; at most 20 m away."""

    def missing(x):
        return float(_potential(p, -x)) - energy

    return -float(brentq(missing, 0.0, 20.0)) if missing(20.0) > 0 else -20.0


def _time(p, energy, start, end):
    """Time of the way between two places, without a push."""

    def speed_at(x):
        return np.sqrt(np.maximum(2 * (energy - _potential(p, x)), 1e-9))

    return float(np.sum(parts_of_way(speed_at, start, end, 4000)[0]))


def _predict(p):
    """Farthest place on the other side, and time of a full swing."""
    energy = float(_potential(p, START))
    other = _turn(p, energy)
    return [other, 2 * _time(p, energy, START, other)]


def solve(task):
    """One push to begin with, then half swings that no plausible potential leads too far."""
    seen = yield from PUMP.pumped(RIG.leg(FORCE, 0.4, looks=4), _plausible)
    yield [answer(_predict(_best(seen).constants))]


def fit(readings, structure):
    """Both numbers by the cords of a structure."""
    return _predict(_fitted(structure, readings).constants)


def rivals(readings):
    """The cords of each structure, fitted with the errors that follow from the best of them."""
    x, energy, speed, force, doubt = _points(readings)
    fits = _fits(readings)
    best = cheapest(fits, len(x)).constants
    return weighed(
        fits,
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
    half = _time(p, float(_potential(p, START)), START, 0.0)
    largest = -_turn(p, float(_potential(p, 1.0))) * START
    swing = 2 * _time(p, float(_potential(p, 1.0)), 1.0, -largest / START)
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
    yield [answer(_predict(_best(list(zip(calls, readings, strict=True))).constants))]


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
