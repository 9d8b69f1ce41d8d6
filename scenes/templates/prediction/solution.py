"""Scene SCENE_ID: steady speeds at several forces, and the law of resistance that explains them."""

from math import log, sqrt

import numpy as np

from scenes.family import member
from scenes.protocol import answer, call

ASKED_N = 60.0
FORCES_N = (10.0, 9.0, 8.0, 7.0, 6.0, 5.5)
SETTLE_S = 15.0
ERROR_M_S = 2e-3
"""Standard deviation of a speed: the remaining difference from the steady speed is larger than the rounding."""
TERMS = {"dry and linear": (0, 1), "dry and quadratic": (0, 2), "linear and quadratic": (1, 2)}


def solve(task):
    """Read the steady speed at six forces; keep the two terms that explain them best."""
    pushes = []
    for force in FORCES_N:
        readings = yield steady(force)
        pushes.append((force, readings[-1]["velocity"][0]))
    best = min(TERMS.values(), key=lambda terms: law(pushes, terms)[1])
    yield [answer(speed(*law(pushes, best)[0], ASKED_N))]


def steady(force):
    """Push until the speed no longer changes, which a second reading shows."""
    look = call("get_velocity", object_id="object_1")
    half = call("step", duration=SETTLE_S / 2)
    return [call("apply_force", object_id="object_1", force_vector=[force, 0, 0]), half, look, half, look]


def law(pushes, terms):
    """The factors f, c, k of the law with these powers of the speed, and its largest residual force."""
    forces, speeds = np.array(pushes).T
    powers = np.array([speeds**power for power in terms]).T
    found = np.linalg.lstsq(powers, forces, rcond=None)[0]
    factors = [0.0, 0.0, 0.0]
    for power, factor in zip(terms, found, strict=True):
        factors[power] = factor
    return factors, float(np.abs(powers @ found - forces).max())


def speed(f, c, k, force):
    """The speed at which the resistance f + c v + k v² equals a force."""
    excess = max(force - f, 0.0)
    return excess / c if abs(k) < 1e-12 else (sqrt(c * c + 4 * k * excess) - c) / (2 * k)


def theory(knobs):
    """The speed at which the resistance equals the push."""
    return speed(knobs["f"], knobs["c"], knobs["k"], ASKED_N)


def measure(engine, knobs):
    """The steady speed in the engine."""
    engine.push("object_1", force=[ASKED_N, 0.0, 0.0])
    engine.step(engine.whole_steps(40.0))
    return float(engine.twist("object_1").linear[0])


def last_speeds(readings):
    """The last speed at each force."""
    pushes, force = {}, 0.0
    for asked, reading in readings:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "get_velocity":
            pushes[force] = reading["velocity"][0]
    return list(pushes.items())


def fit(readings, structure):
    """The law with the terms of this structure, fitted to the last speed at each force."""
    return speed(*law(last_speeds(readings), TERMS[structure])[0], ASKED_N)


def rivals(readings):
    """The fit of every pair of terms."""
    pushes = last_speeds(readings)

    def weighed(terms):
        def factors(constants):
            return [dict(zip(terms, constants, strict=True)).get(power, 0.0) for power in range(3)]

        return member(
            lambda constants: np.array([speed(*factors(constants), force) - v for force, v in pushes]) / ERROR_M_S,
            lambda constants: speed(*factors(constants), ASKED_N),
            [law(pushes, terms)[0][power] for power in terms],
            [(0.0, 10.0), (0.0, 10.0)],
        )

    return {kind: weighed(terms) for kind, terms in TERMS.items()}


def settles(engine, knobs, off):
    """The relative error of the speed at the end if the cart starts with the relative error `off`."""
    asked = theory(knobs)
    engine.set_velocity("object_1", [(1 + off) * asked, 0.0, 0.0])
    engine.push("object_1", force=[ASKED_N, 0.0, 0.0])
    engine.step(engine.whole_steps(40.0))
    return float(engine.twist("object_1").linear[0]) / asked - 1


def stage(task):
    """Push with the asked force."""
    readings = yield steady(ASKED_N)
    yield [answer(readings[-1]["velocity"][0])]


def naive(knobs):
    """Extrapolate the speed at 10 N in proportion to the force, or to its square root."""
    known = speed(knobs["f"], knobs["c"], knobs["k"], 10.0)
    return {"proportional": known * ASKED_N / 10, "root": known * sqrt(ASKED_N / 10)}


def batch(task):
    """Two steady speeds, and the power law through them."""
    readings = yield [*steady(7.0), *steady(10.0)]
    slow, fast = readings[4]["velocity"][0], readings[-1]["velocity"][0]
    yield [answer(fast * (ASKED_N / 10) ** (log(fast / slow) / log(10 / 7)))]
