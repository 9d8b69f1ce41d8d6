"""Scene 34: periods at a few distances give the law, the law a better place to measure around."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
AXLE_Z = 2.0
FIRST_GUESS = 0.3
SHARES = (0.6, 1.0, 1.7)
NEAREST, FARTHEST = 0.06, 0.88
ROUNDS = 3
KICK_N, KICK_S = 0.5, 0.1
LOOK_S, LOOKS = 0.08, 20
CALM_S = 20.0
"""By then a swing has lost all but a few hundredths."""


def _swing(distance):
    """Clamp the bar while it hangs at rest, push it for a moment, look at it at even intervals, let it calm."""
    look = [call("step", duration=LOOK_S), call("get_position", object_id="object_1")]
    return [
        call("move_object", object_id="object_1", x=0, y=0, z=AXLE_Z - distance),
        call("apply_force", object_id="object_1", force_vector=[KICK_N, 0, 0]),
        call("step", duration=KICK_S),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        *(look * LOOKS),
        call("step", duration=CALM_S),
    ]


def _rate(places):
    """Angular frequency of a fading swing from even looks: next = p x - q (one before), q the fading squared."""
    x = np.array(places)
    (p, q), *_ = np.linalg.lstsq(np.column_stack([x[1:-1], -x[:-2]]), x[2:], rcond=None)
    return float(np.arccos(p / (2 * np.sqrt(q)))) / LOOK_S


def _law(distances, rates):
    """k² and κ per mass from ω² (k² + d²) = g d + κ."""
    d, squares = np.array(distances), np.array(rates) ** 2
    (law, spring), *_ = np.linalg.lstsq(
        np.column_stack([squares, -np.ones(len(d))]), GRAVITY * d - squares * d**2, rcond=None
    )
    return max(law, 1e-4), spring


def _best(law, spring):
    """Positive root of g d² + 2 κ d = g k², with κ per mass."""
    return sqrt((spring / GRAVITY) ** 2 + law) - spring / GRAVITY


def solve(task):
    """Three distances give the law, and the law the best distance, around which the next three lie."""
    guess = FIRST_GUESS
    for _ in range(ROUNDS):
        distances = [min(max(share * guess, NEAREST), FARTHEST) for share in SHARES]
        readings = yield [one for distance in distances for one in _swing(distance)]
        chunk = len(readings) // len(distances)
        rates = []
        for turn in range(len(distances)):
            looks = readings[turn * chunk + 5 : (turn + 1) * chunk : 2]
            rates.append(_rate([look["position"][0] for look in looks]))
        guess = min(max(_best(*_law(distances, rates)), NEAREST), FARTHEST)
    yield [answer(guess)]


def theory(knobs):
    """Where the derivative of (k² + d²) / (g d + κ) vanishes."""
    return _best(knobs["k"] ** 2, knobs["spring"])


def measure(engine, knobs):
    """The law from five close distances around the best in the engine, looked at twice as often."""
    start, middle = engine.save(), theory(knobs)
    distances = np.array([0.8, 0.9, 1.0, 1.1, 1.2]) * middle
    rates = []
    for distance in distances:
        engine.restore(start)
        engine.place("object_1", np.array([0.0, 0.0, AXLE_Z - distance]), {})
        engine.push("object_1", force=[KICK_N, 0.0, 0.0])
        engine.step(engine.whole_steps(KICK_S))
        engine.push("object_1", force=[0.0, 0.0, 0.0])
        places = []
        for _ in range(3 * LOOKS):
            engine.step(engine.whole_steps(LOOK_S / 2))
            places.append(engine.pose("object_1").position[0])
        rates.append(2 * _rate(places))
    return float(_best(*_law(distances, rates)))
