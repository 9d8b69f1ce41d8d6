"""Scene 96: halve the range of the downward and of the upward force at which the crate begins to slide."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
SINE = sqrt(0.5)
MOST_N = 32.0
ROUNDS = 12
COARSE = 5


def _test(weight, force, watch, rest):
    """Pull at the weight and look whether the crate stirs; then let it come to rest."""
    return [
        call("get_position", object_id="object_1"),
        call("apply_force", object_id=weight, force_vector=[0, 0, force]),
        call("step", duration=watch),
        call("get_position", object_id="object_1"),
        call("apply_force", object_id=weight, force_vector=[0, 0, 0]),
        call("step", duration=rest),
    ]


def _stirred(readings, limit):
    return abs(readings[3]["position"][0] - readings[0]["position"][0]) > limit


def solve(task):
    """The hanging weight, more or less, at the two limits of rest gives the crate's weight and friction."""
    found = yield [call("find_objects")]
    weight = found[0]["revealed"][0]
    name = weight["object_id"]
    down, up = [0.0, MOST_N], [0.0, MOST_N]
    for turn in range(ROUNDS):
        # Short looks while the force may be far too large, longer ones for the fine steps.
        watch, limit, rest = (0.25, 0.0003, 4.0) if turn < COARSE else (0.8, 0.0007, 1.0)
        pulls = (sum(down) / 2, sum(up) / 2)
        readings = yield [*_test(name, -pulls[0], watch, rest), *_test(name, pulls[1], watch, rest)]
        down[_stirred(readings[:6], limit)] = pulls[0]
        up[_stirred(readings[6:], limit)] = pulls[1]
    most = weight["mass"] * GRAVITY + sum(down) / 2
    least = weight["mass"] * GRAVITY - sum(up) / 2
    yield [answer([(most + least) / (2 * GRAVITY * SINE), (most - least) / (most + least)])]


def theory(knobs):
    """The mass and the coefficient that were drawn."""
    return [knobs["M"], knobs["mu"]]


def _limit(engine, sign):
    """The force on the weight [N] at which the crate begins to slide, from a fresh state each time."""
    start = engine.save()
    low, high = 0.0, MOST_N
    for _ in range(16):
        force = (low + high) / 2
        engine.restore(start)
        before = engine.pose("object_1").position[0]
        engine.push("object_3", force=np.array([0.0, 0.0, sign * force]))
        engine.step(engine.whole_steps(1.0))
        if abs(engine.pose("object_1").position[0] - before) > 0.001:
            high = force
        else:
            low = force
    engine.restore(start)
    return (low + high) / 2


def measure(engine, knobs):
    """The same two limits in the engine."""
    most = knobs["m"] * GRAVITY + _limit(engine, -1.0)
    least = knobs["m"] * GRAVITY - _limit(engine, 1.0)
    return [(most + least) / (2 * GRAVITY * SINE), (most - least) / (most + least)]
