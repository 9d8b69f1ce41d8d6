"""Scene 80: find the pace by ever longer steps, then the middle and pace of the first half swing from even looks."""

from math import acos

import numpy as np

from scenes.protocol import answer, call

MASS = 1.0
START_M = 0.4
FIRST_S, GROWTH, GLANCES = 0.01, 1.25, 22
LOOKS_PER_SWING = 60
LOOKS = 18
"""Three tenths of what is at most 1.4 swings: the block has surely not turned yet."""
STEP_S = 0.005


def _let_go():
    return [
        call("move_object", object_id="object_1", x=START_M, y=0, z=1),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
    ]


def _look(duration):
    return [call("step", duration=duration), call("get_position", object_id="object_1")]


def _half_swing(places, pause):
    """Angular frequency and middle from even looks: next + before = 2 cos(ω pause) now + 2 (1 - cos) middle."""
    x = np.array(places)
    (slope, level), *_ = np.linalg.lstsq(np.column_stack([x[1:-1], np.ones(len(x) - 2)]), x[2:] + x[:-2], rcond=None)
    return acos(slope / 2) / pause, level / (2 - slope)


def solve(task):
    """Stiffness m ω², friction that times the middle of the half swing."""
    pauses = [FIRST_S * GROWTH**turn for turn in range(GLANCES)]
    readings = yield [*_let_go(), *(one for pause in pauses for one in _look(pause))]
    looks = readings[3::2]
    passed = next(index for index, look in enumerate(looks) if look["position"][0] < 0)
    quarter = (looks[passed]["sim_time"] + looks[max(passed - 1, 0)]["sim_time"]) / 2 - readings[1]["sim_time"]
    pause = max(round(4 * quarter / LOOKS_PER_SWING / STEP_S), 1) * STEP_S
    looks = (yield [*_let_go(), *(one for _ in range(LOOKS) for one in _look(pause))])[3::2]
    frequency, middle = _half_swing([look["position"][0] for look in looks], pause)
    yield [answer(MASS * frequency**2 * middle)]


def theory(knobs):
    """Stiffness times the shift that was drawn."""
    return knobs["k"] * knobs["shift"]


def measure(engine, knobs):
    """Half the loss of width in a half swing times the stiffness, from the turning point in the engine."""
    engine.place("object_1", np.array([START_M, 0.0, 1.0]), {})
    places = [START_M, START_M]
    while places[-1] <= places[-2]:
        engine.step(1)
        places.append(float(engine.pose("object_1").position[0]))
    before, turn, after = places[-3:]
    lowest = turn - (before - after) ** 2 / (8 * (before - 2 * turn + after))
    return knobs["k"] * (START_M + lowest) / 2
