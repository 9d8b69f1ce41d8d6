"""Scene 47: strike all three targets at one speed after another, and close in on the first failure."""

from math import log, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.2
LANES = {"object_1": -2.0, "object_2": 0.0, "object_3": 2.0}
SHARE = 0.7
SLOWEST, FASTEST = 0.8, 8.0
ROUNDS = 10
GAP = 0.01
CONTACT_S = 0.22
"""Longer than a contact lasts."""
STEP_S = 0.005


def _wait(speed):
    """From the start in front of a target until the two have parted, in whole time steps."""
    return STEP_S * round((GAP / speed + CONTACT_S) / STEP_S)


def _strike(striker, target, place, pace, speed):
    """Set the striker down in front of a target that is on its way, and let it catch up. Momenta of 1 kg are speeds."""
    return [
        call("move_object", object_id=striker, x=place - RADIUS - GAP, y=LANES[target], z=0),
        call("set_velocity", object_id=striker, velocity_vector=[pace + speed, 0, 0]),
        call("step", duration=_wait(speed)),
        call("get_momentum", object_id=striker, mass=1.0),
        call("get_momentum", object_id=target, mass=1.0),
        call("get_position", object_id=target),
    ]


def solve(task):
    """Close in on the excess of the least share over the one wanted; halve where the chord is of no use."""
    found = yield [call("find_objects")]
    striker = found[0]["revealed"][0]["object_id"]
    state = dict.fromkeys(LANES, (0.0, 0.0, 0.0))
    clock = 0.0
    low, high, at_low, at_high = log(SLOWEST), log(FASTEST), None, None
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        if at_low is not None and at_high is not None:
            middle = low + (high - low) * min(max(at_low / (at_low - at_high), 0.15), 0.85)
        speed = float(np.exp(middle))
        calls = []
        for number, target in enumerate(LANES):
            place, pace, then = state[target]
            now = clock + number * _wait(speed)
            calls += _strike(striker, target, place + pace * (now - then), pace, speed)
        readings = yield calls
        shares = []
        for number, target in enumerate(LANES):
            mine, its, place = readings[6 * number + 3 : 6 * number + 6]
            shares.append((its["momentum"]["x"] - mine["momentum"]["x"]) / speed)
            state[target] = (place["position"][0], its["momentum"]["x"], place["sim_time"])
        clock = readings[-1]["sim_time"]
        excess = min(shares) - SHARE
        if excess > 0:
            low, at_low = middle, excess
        else:
            high, at_high = middle, excess
    yield [answer(float(np.exp((low + high) / 2 if at_low is None or at_high is None else middle)))]


def _kept(engine, target, speed):
    """The share kept by a target at rest."""
    engine.place("object_4", np.array([-RADIUS - GAP, LANES[target], 0.0]), {})
    engine.set_velocity("object_4", np.array([speed, 0.0, 0.0]))
    engine.step(engine.whole_steps(_wait(speed)))
    return float(engine.twist(target).linear[0] - engine.twist("object_4").linear[0]) / speed


def measure(engine, knobs):
    """The least of the engine's three critical speeds, each found by halving."""
    start, least = engine.save(), FASTEST
    for target in LANES:
        slow, fast = SLOWEST / 2, least
        for _ in range(13):
            speed = sqrt(slow * fast)
            engine.restore(start)
            slow, fast = (slow, speed) if _kept(engine, target, speed) < SHARE else (speed, fast)
        least = min(least, sqrt(slow * fast))
    return least
