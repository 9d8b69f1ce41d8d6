"""Scene 79: find the pace by ever longer steps, then both frequencies from even looks at a fresh swing."""

from math import acos, pi, sqrt

import numpy as np

from scenes.protocol import answer, call

GLIDERS = {"object_1": 0.0, "object_2": 1.0}
SHIFT_M = 0.2
FIRST_S, GROWTH, GLANCES = 0.01, 1.25, 26
LOOKS_PER_SWING = 20
LOOKS = 80
STEP_S = 0.005


def _let_go():
    """Both at rest, the first off its place."""
    calls = []
    for glider, home in GLIDERS.items():
        shift = SHIFT_M if glider == "object_1" else 0.0
        calls += [
            call("move_object", object_id=glider, x=home + shift, y=0, z=1),
            call("set_velocity", object_id=glider, velocity_vector=[0, 0, 0]),
        ]
    return calls


def _look(duration):
    return [call("step", duration=duration), *(call("get_position", object_id=glider) for glider in GLIDERS)]


def _frequency(places, pause):
    """Angular frequency of a pure swing from even looks: next + before = 2 cos(ω pause) now."""
    x = np.array(places)
    return acos(float(x[1:-1] @ (x[2:] + x[:-2]) / (x[1:-1] @ x[1:-1])) / 2) / pause


def _quarter(places, times):
    """A time about a quarter of a swing: between the looks where the first glider passes its place."""
    first = next(index for index, place in enumerate(places) if place < 0)
    return (times[first] + (times[first - 1] if first else 0.0)) / 2


def solve(task):
    """The sum of both places swings with one frequency, the difference with the other."""
    pauses = [FIRST_S * GROWTH**turn for turn in range(GLANCES)]
    readings = yield [*_let_go(), *(one for pause in pauses for one in _look(pause))]
    looks = readings[4:]
    times = [look["sim_time"] - readings[3]["sim_time"] for look in looks[1::3]]
    quarter = _quarter([look["position"][0] for look in looks[1::3]], times)
    pause = max(round(4 * quarter / LOOKS_PER_SWING / STEP_S), 1) * STEP_S
    looks = (yield [*_let_go(), *(one for _ in range(LOOKS) for one in _look(pause))])[4:]
    one, two = (np.array([look["position"][0] for look in looks[nth::3]]) for nth in (1, 2))
    two = two - GLIDERS["object_2"]
    yield [answer(pi / (_frequency(one - two, pause) - _frequency(one + two, pause)))]


def theory(knobs):
    """π / (ω₂ - ω₁)."""
    k = knobs["w"] ** 2
    joint = k * ((1 + 0.5 / knobs["swings"]) ** 2 - 1) / 2
    return pi / (sqrt(k + 2 * joint) - sqrt(k))


def measure(engine, knobs):
    """The same from passages of zero, of sum and difference, over several swings in the engine."""
    engine.place("object_1", np.array([SHIFT_M, 0.0, 1.0]), {})
    sums, differences = [2 * SHIFT_M], [2 * SHIFT_M]
    for _ in range(engine.whole_steps(6 * 2 * pi / knobs["w"])):
        engine.step(1)
        one, two = engine.pose("object_1").position[0], engine.pose("object_2").position[0] - 1.0
        sums.append(one + two)
        differences.append(one - two)

    def frequency(places):
        x = np.array(places)
        (before,) = np.nonzero(x[:-1] * x[1:] < 0)
        passages = before + x[before] / (x[before] - x[before + 1])
        return pi * (len(passages) - 1) / (passages[-1] - passages[0]) / engine.timestep

    return pi / (frequency(differences) - frequency(sums))
