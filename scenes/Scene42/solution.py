"""Scene 42: balls of ever better matched mass, each laid into the raised pan."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
RAISED = [-0.5, 0.0, 1.05 + RADIUS + 0.002]
LIGHTEST, HEAVIEST = 0.3, 8.0
ROUNDS = 9
WATCH_S, BACK_S = 5.0, 3.0
SUNK_M = 0.05


def solve(task):
    """Halve the range of masses, in proportion, by whether the ball goes down."""
    low, high = LIGHTEST, HEAVIEST
    yield [call("step", duration=BACK_S)]
    for tried in range(ROUNDS):
        mass = sqrt(low * high)
        name = f"weight{tried}"
        readings = yield [
            call("create_objects", name=name, pos=RAISED, density=mass / VOLUME, rgba=[1, 0, 0, 1], radius=RADIUS),
            call("step", duration=WATCH_S),
            call("get_position", object_id=name),
            call("delete_objects", object_id=name),
            call("step", duration=BACK_S),
        ]
        if readings[2]["position"][2] < RAISED[2] - SUNK_M:
            high = mass
        else:
            low = mass
    yield [answer(sqrt(low * high))]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["load"]


def measure(engine, knobs):
    """A finer search in the engine around the true mass, by the loaded pan."""
    engine.step(engine.whole_steps(BACK_S))
    start, low, high = engine.save(), 0.9 * knobs["load"], 1.1 * knobs["load"]
    for _ in range(7):
        mass = sqrt(low * high)
        engine.restore(start)
        engine.add_ball("weight", np.array(RAISED), mass / VOLUME, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(WATCH_S))
        low, high = (low, mass) if engine.pose("object_2").position[2] > 1.0 else (mass, high)
    return sqrt(low * high)
