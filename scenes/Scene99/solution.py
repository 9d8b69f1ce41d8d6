"""Scene 99: bisect the force that just moves each block; then one short strong push weighs it."""

from math import sqrt

from scenes.protocol import answer, call

WEAKEST, STRONGEST = 0.2, 40.0
ROUNDS = 9
WATCH_S = 1.0
STIRRED_M = 1e-3
HARD = 6.0
"""The weighing push, in thresholds."""
HARD_S = 0.1
SLIDE_S = 3.0


def solve(task):
    """All three blocks at once: they do not disturb one another."""
    found = yield [call("find_objects")]
    blocks = [one["object_id"] for one in found[0]["revealed"]]
    low, high = dict.fromkeys(blocks, WEAKEST), dict.fromkeys(blocks, STRONGEST)
    places = {one["object_id"]: one["position"][0] for one in found[0]["revealed"]}
    for _ in range(ROUNDS):
        tried = {block: sqrt(low[block] * high[block]) for block in blocks}
        readings = yield [
            *(call("apply_force", object_id=block, force_vector=[tried[block], 0, 0]) for block in blocks),
            call("step", duration=WATCH_S),
            *(call("get_position", object_id=block) for block in blocks),
            *(call("apply_force", object_id=block, force_vector=[0, 0, 0]) for block in blocks),
            call("step", duration=SLIDE_S),
            *(call("get_position", object_id=block) for block in blocks),
        ]
        for block, seen, rest in zip(blocks, readings[4:7], readings[-3:], strict=True):
            if abs(seen["position"][0] - places[block]) > STIRRED_M:
                high[block] = tried[block]
            else:
                low[block] = tried[block]
            places[block] = rest["position"][0]
    threshold = {block: sqrt(low[block] * high[block]) for block in blocks}
    readings = yield [
        *(call("apply_force", object_id=block, force_vector=[HARD * threshold[block], 0, 0]) for block in blocks),
        call("step", duration=HARD_S),
        *(call("get_position", object_id=block) for block in blocks),
    ]
    # In so short a time drag is small: d = (F - f) t² / 2m.
    friction = {}
    for block, seen in zip(blocks, readings[-3:], strict=True):
        moved = seen["position"][0] - places[block]
        mass = (HARD - 1) * threshold[block] * HARD_S**2 / (2 * moved)
        friction[block] = threshold[block] / mass
    yield [answer(min(blocks, key=friction.__getitem__))]


def theory(knobs):
    """The block of rank 0."""
    return f"object_{2 + list(knobs['order']).index(0)}"


def measure(engine, knobs):
    """From the engine's own first acceleration under a force of three weights: μ = 3 - a / g."""
    friction = {}
    for body in ("object_2", "object_3", "object_4"):
        weight = engine.mass(body) * 9.81
        engine.push(body, force=[3 * weight, 0.0, 0.0])
    engine.step(1)
    for body in ("object_2", "object_3", "object_4"):
        friction[body] = 3 - engine.acceleration(body)[0] / 9.81
    return min(friction, key=friction.get)
