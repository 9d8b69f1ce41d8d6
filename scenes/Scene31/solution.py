"""Scene 31: halve the range of torques by whether the mark on the rim moves."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

WEAKEST, STRONGEST = 0.2, 9.0
ROUNDS = 11
WATCH_S, BACK_S = 3.0, 10.0
MOVED_M = 0.002


def _torque(size):
    return call("apply_torque", object_id="object_1", torque_vector=[0, size, 0])


def solve(task):
    """The range is halved in proportion; between trials friction and drag stop the wheel."""
    low, high = WEAKEST, STRONGEST
    for _ in range(ROUNDS):
        torque = sqrt(low * high)
        readings = yield [
            call("get_position", object_id="object_1"),
            _torque(torque),
            call("step", duration=WATCH_S),
            call("get_position", object_id="object_1"),
            _torque(0),
            call("step", duration=BACK_S),
        ]
        way = np.subtract(readings[3]["position"], readings[0]["position"])
        low, high = (low, torque) if np.linalg.norm(way) > MOVED_M else (torque, high)
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """The torque of the dry friction."""
    return knobs["limit"]


def measure(engine, knobs):
    """A finer search in the engine, each time from the same rest."""
    start, low, high = engine.save(), 0.9 * knobs["limit"], 1.1 * knobs["limit"]
    for _ in range(8):
        torque = (low + high) / 2
        engine.restore(start)
        here = engine.pose("object_1").position.copy()
        engine.push("object_1", torque=[0.0, torque, 0.0])
        engine.step(engine.whole_steps(2 * WATCH_S))
        moved = np.linalg.norm(engine.pose("object_1").position - here) > MOVED_M
        low, high = (low, torque) if moved else (torque, high)
    return float((low + high) / 2)
