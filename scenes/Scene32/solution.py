"""Scene 32: raise the torque until the edge lifts, then close in between standing and lifting."""

from math import sqrt

from scenes.protocol import answer, call

GRAVITY = 9.81
HALF_WIDTH = 0.2
FIRST = 3.0
RAISE = 1.5
GLANCE_S, WATCH_S, BACK_S = 0.2, 0.3, 2.0
"""After a large step of the torque a glance is enough, and the crate falls back sooner."""
LIFTED_M = 0.001
ROUNDS = 7


def _try(torque, duration):
    """Push for a moment, look, let go and wait."""
    return [
        call("get_position", object_id="object_1"),
        call("apply_torque", object_id="object_1", torque_vector=[0, -torque, 0]),
        call("step", duration=duration),
        call("get_position", object_id="object_1"),
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, 0]),
        call("step", duration=BACK_S),
    ]


def _lifted(readings):
    return readings[3]["position"][2] - readings[0]["position"][2] > LIFTED_M


def solve(task):
    """A torque a little too large lifts the edge by centimetres, from where the crate falls back."""
    yield [call("step", duration=BACK_S)]
    torque = FIRST
    while not _lifted((yield _try(torque, GLANCE_S))):
        torque *= RAISE
    low, high = torque / RAISE, torque
    for _ in range(ROUNDS):
        torque = sqrt(low * high)
        low, high = (low, torque) if _lifted((yield _try(torque, WATCH_S))) else (torque, high)
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """About the other lower edge: the weight, at half the width and the offset from it."""
    return knobs["mass"] * GRAVITY * (HALF_WIDTH + knobs["offset"])


def measure(engine, knobs):
    """A finer search in the engine, each time from the same rest."""
    engine.step(engine.whole_steps(BACK_S))
    start, wanted = engine.save(), theory(knobs)
    low, high = 0.9 * wanted, 1.1 * wanted
    height = engine.pose("object_1").position[2]
    for _ in range(8):
        torque = (low + high) / 2
        engine.restore(start)
        engine.push("object_1", torque=[0.0, -torque, 0.0])
        engine.step(engine.whole_steps(2 * WATCH_S))
        lifted = engine.pose("object_1").position[2] - height > LIFTED_M
        low, high = (low, torque) if lifted else (torque, high)
    return float((low + high) / 2)
