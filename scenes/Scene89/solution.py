"""Scene 89: find roughly when the ball passes the bottom by ever longer steps, then look closely around that moment."""

from itertools import pairwise
from math import sin, sqrt

import numpy as np

from scenes.protocol import answer, call

SIDE = {"x": 1.0, "y": 0, "z": 2.0}
FIRST_S, GROWTH, GLANCES = 0.05, 1.15, 26
LOOKS = 24
STEP_S = 0.005


def _let_go():
    return [
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("move_object", object_id="object_1", **SIDE),
    ]


def _look(duration):
    return [call("step", duration=duration), call("get_position", object_id="object_1")]


def _passage(readings):
    """Time from the letting go to the first passage of x = 0, between the looks before and after it."""
    started = readings[1]["sim_time"]
    looks = [(reading["sim_time"] - started, reading["position"][0]) for reading in readings[3::2]]
    for (early, before), (late, after) in pairwise([(0.0, SIDE["x"]), *looks]):
        if before > 0 >= after:
            return early, late, early + (late - early) * before / (before - after)
    return looks[-1][0], looks[-1][0], looks[-1][0]


def solve(task):
    """A quarter of the swing lies between the letting go and the bottom."""
    pauses = [FIRST_S * GROWTH**turn for turn in range(GLANCES)]
    readings = yield [*_let_go(), *(one for pause in pauses for one in _look(pause))]
    early, late, _ = _passage(readings)
    pause = max(round((late - early) / LOOKS / STEP_S), 1) * STEP_S
    looks = [one for _ in range(LOOKS + 1) for one in _look(pause)]
    readings = yield [*_let_go(), *_look(max(early, STEP_S)), *looks]
    yield [answer(4 * _passage(readings)[2])]


def theory(knobs):
    """T = 4 ∫ dθ / θ' from the side to the bottom; with cos θ = sin u² nothing is infinite in it."""
    pull, field = 2 * knobs["g"], knobs["share"] * knobs["g"]

    def integrand(u):
        height = sin(u * u)
        return 2 * u / sqrt(pull * height + field * height**2) if u else 2 / sqrt(pull)

    ends, halves = sqrt(np.pi / 2), 100
    step = ends / (2 * halves)
    inner = sum((4 if number % 2 else 2) * integrand(number * step) for number in range(1, 2 * halves))
    return 4 * float(step / 3 * (integrand(0.0) + inner + integrand(ends)))


def measure(engine, knobs):
    """The first two passages of the bottom in the engine are half a swing apart."""
    engine.place("object_1", np.array(list(SIDE.values())), {})
    passages, before, steps = [], SIDE["x"], 0
    while len(passages) < 2:
        engine.step(1)
        after = engine.pose("object_1").position[0]
        if before * after <= 0 and before != after:
            passages.append(steps + before / (before - after))
        before, steps = after, steps + 1
    return 2 * float(passages[1] - passages[0]) * engine.timestep
