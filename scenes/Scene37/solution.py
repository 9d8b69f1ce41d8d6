"""Scene 37: balance the beam by the rider twice, with the load far out and near; the difference weighs the load."""

from math import hypot

import numpy as np

from scenes.protocol import answer, call

RIDER_KG = 2.0
PIVOT_Z = 1.0
FAR, NEAR = 0.6, 0.15
LEFT, RIGHT = -0.4, 2.4
ROUNDS = 7
TRIALS = 3
"""Places of the rider tried in each round: they cut the range into four."""
TIP_S = 5.0
LOOK_S = 0.2
MOVED_M = 1e-6


def _put(piece, x):
    return call("move_object", object_id=piece, x=x, y=0, z=PIVOT_Z)


def _height(piece):
    """Height above the floor, as the potential energy of 1 kg where g is 1."""
    return call("get_potential_energy", object_id=piece, mass=1.0, gravity=1.0)


def _trial(x):
    """Set the rider down, wait, and see which way the beam lies or goes."""
    return [
        _put("object_3", x),
        call("step", duration=TIP_S),
        _height("object_2"),
        call("step", duration=LOOK_S),
        _height("object_2"),
        call("get_position", object_id="object_3"),
    ]


def _sinks(readings):
    """Whether the load's side goes down, or lies down."""
    before, after = readings[2]["potential_energy"], readings[4]["potential_energy"]
    return after - before < -MOVED_M or (after - before < MOVED_M and after < PIVOT_Z)


def _arm(readings):
    """The rider's distance from the knife edge, along the beam."""
    x, _, z = readings[5]["position"]
    return np.sign(x) * hypot(x, z - PIVOT_Z)


def _balance():
    """The rider's arm at balance, by cutting the range into four again and again."""
    low, high = LEFT, RIGHT
    for _ in range(ROUNDS):
        places = [low + (high - low) * share / (TRIALS + 1) for share in range(1, TRIALS + 1)]
        calls = [_trial(x) for x in places]
        readings = yield [one for trial in calls for one in trial]
        parts = [readings[k * len(calls[0]) : (k + 1) * len(calls[0])] for k in range(TRIALS)]
        arms = [low, *(_arm(part) for part in parts), high]
        count = sum(_sinks(part) for part in parts)
        low, high = arms[count], arms[count + 1]
    return (low + high) / 2


def solve(task):
    """Balance with the load where it is, move it inwards, balance again."""
    far = yield from _balance()
    yield [_put("object_2", -NEAR)]
    near = yield from _balance()
    yield [answer(float(RIDER_KG * (far - near) / (FAR - NEAR)))]


def theory(knobs):
    """The mass of the load."""
    return knobs["load"]


def _balance_in(engine, load):
    """The engine's own balance: where the rider leaves the level beam level, from the sign of its first tilt."""
    start = engine.save()
    low, high = LEFT, RIGHT
    for _ in range(30):
        rider = (low + high) / 2
        engine.restore(start)
        engine.place("object_2", np.array([-load, 0.0, PIVOT_Z]), {})
        engine.place("object_3", np.array([rider, 0.0, PIVOT_Z]), {})
        engine.step(engine.whole_steps(0.1))
        low, high = (rider, high) if engine.pose("object_2").position[2] < PIVOT_Z else (low, rider)
    engine.restore(start)
    return (low + high) / 2


def measure(engine, knobs):
    """Two balances of the level beam in the engine."""
    return RIDER_KG * (_balance_in(engine, FAR) - _balance_in(engine, NEAR)) / (FAR - NEAR)
