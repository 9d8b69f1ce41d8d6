"""Scene 82: find roughly when the puck is farthest by ever longer steps, then look closely around that moment."""

from math import hypot

import numpy as np

from scenes.protocol import answer, call

START_M, SPEED = 0.5, 2.0
FIRST_S, GROWTH, GLANCES = 0.05, 1.12, 32
LOOKS = 30
STEP_S = 0.005


def _send_off():
    return [
        call("move_object", object_id="object_1", x=START_M, y=0, z=1),
        call("set_velocity", object_id="object_1", velocity_vector=[0, SPEED, 0]),
    ]


def _look(duration):
    return [call("step", duration=duration), call("get_position", object_id="object_1")]


def _distances(readings):
    return [hypot(*reading["position"][:2]) for reading in readings[3::2]]


def _first_peak(distances):
    """Index of the first look after which the puck is nearer again."""
    return next(index for index in range(len(distances) - 1) if distances[index + 1] < distances[index])


def solve(task):
    """The largest of the close looks is as near to the greatest distance as one could wish."""
    pauses = [FIRST_S * GROWTH**turn for turn in range(GLANCES)]
    distances = _distances((yield [*_send_off(), *(one for pause in pauses for one in _look(pause))]))
    peak = _first_peak(distances)
    before = sum(pauses[:peak])
    pause = max(round(sum(pauses[peak : peak + 2]) / LOOKS / STEP_S + 0.5), 1) * STEP_S
    readings = yield [*_send_off(), *_look(before or STEP_S), *(one for _ in range(LOOKS) for one in _look(pause))]
    yield [answer(max(_distances(readings)))]


def theory(knobs):
    """The distance at which v² (1 - r₀² / r²) = k (r - L)² / m, by halving."""
    low, high = max(knobs["length"], START_M), 10.0
    for _ in range(60):
        r = (low + high) / 2
        left = SPEED**2 * (1 - (START_M / r) ** 2) - knobs["k"] * (r - knobs["length"]) ** 2
        low, high = (r, high) if left > 0 else (low, r)
    return low


def measure(engine, knobs):
    """The puck's path in the engine, up to its first return."""
    engine.set_velocity("object_1", np.array([0.0, SPEED, 0.0]))
    farthest = distance = START_M
    while distance >= farthest:
        farthest = distance
        engine.step(1)
        distance = float(np.linalg.norm(engine.pose("object_1").position[:2]))
    return farthest
