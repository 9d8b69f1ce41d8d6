"""Scene 27: bring the climber up, look for an instant whether the foot stirs, and close in from below."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

LENGTH = 4.0
FOOT_Z = 0.02
SLOPE = radians(60)
CLIMBER_KG = 20.0
SAFE = 0.5
TOP = 3.9
ROUNDS = 13
BRIEF_S, LONG_S = 0.03, 0.1
STIRRED_M, SLID_M = 6e-6, 1.5e-5
"""Beyond what a foot that holds creeps in these times, below what one that slides travels."""
REST_S = 0.5
EARLY = 5
CAUTION = 0.35
"""Where in the range the early tries are made: a slip is the shorter the nearer to the limit."""


def _at(distance):
    return {"x": distance * cos(SLOPE), "y": 0, "z": FOOT_Z + distance * sin(SLOPE)}


def solve(task):
    """Every round tries one place for an instant and brings the climber back to where the ladder rests."""
    low, high = SAFE, TOP
    yield [call("step", duration=REST_S)]
    for turn in range(ROUNDS):
        early = turn < EARLY
        place = low + (CAUTION if early else 0.5) * (high - low)
        readings = yield [
            call("get_displacement", object_id="object_1"),
            call("move_object", object_id="object_2", **_at(place)),
            call("step", duration=BRIEF_S if early else LONG_S),
            call("get_displacement", object_id="object_1"),
            call("move_object", object_id="object_2", **_at(SAFE)),
            call("step", duration=REST_S),
        ]
        slip = readings[3]["displacement"] - readings[0]["displacement"]
        if slip > (STIRRED_M if early else SLID_M):
            high = place
        else:
            low = place
    yield [answer((low + high) / 2)]


def theory(knobs):
    """Torques about the point where the foot touches: μ (m + M) g (L sin θ + r) = g cos θ (m c L + M s)."""
    height = LENGTH * sin(SLOPE) + FOOT_Z
    friction = knobs["mu"] * (knobs["m"] + CLIMBER_KG)
    return (friction * height / cos(SLOPE) - knobs["m"] * knobs["c"] * LENGTH) / CLIMBER_KG


def measure(engine, knobs):
    """The engine's limit: halve the range, each time from the same rest, and watch the foot for half a second."""
    engine.step(engine.whole_steps(REST_S))
    rest = engine.save()
    low, high = SAFE, TOP
    for _ in range(14):
        place = (low + high) / 2
        engine.restore(rest)
        before = engine.pose("object_1").position
        at = _at(place)
        engine.place("object_2", np.array([at["x"], at["y"], at["z"]]), {})
        engine.step(engine.whole_steps(0.5))
        if np.linalg.norm(engine.pose("object_1").position - before) > 2e-4:
            high = place
        else:
            low = place
    return (low + high) / 2
