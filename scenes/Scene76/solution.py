"""Scene 76: for each ball, close in on the height from which it keeps half of its energy."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.2
BALLS = {"object_1": -1.0, "object_2": 0.0, "object_3": 1.0}
LOW, HIGH = 0.3, 4.5
ROUNDS = 7
CONTACT_S = 0.2
"""Longer than a ball touches the floor, shorter than it touches the floor and flies on."""
SHARE = 0.5


def _wait(height):
    """From the release at a height to shortly after the bounce."""
    return sqrt(2 * height / GRAVITY) + CONTACT_S


def _drop(ball, height):
    """Let a ball go from a height and read its energies for 1 kg shortly after the bounce."""
    return [
        call("move_object", object_id=ball, x=BALLS[ball], y=0, z=RADIUS + height),
        call("set_velocity", object_id=ball, velocity_vector=[0, 0, 0]),
        call("step", duration=_wait(height)),
        call("get_kinetic_energy", object_id=ball, mass=1.0),
        call("get_potential_energy", object_id=ball, mass=1.0, gravity=GRAVITY),
    ]


def _share(energy, height):
    """Rebound height over drop height, from the energy per mass after the bounce."""
    return (energy / GRAVITY - RADIUS) / height


def solve(task):
    """Halve each ball's range of heights, in proportion, by whether more than half of the energy is left."""
    bounds = {ball: [LOW, HIGH] for ball in BALLS}
    for _ in range(ROUNDS):
        heights = {ball: sqrt(low * high) for ball, (low, high) in bounds.items()}
        readings = yield [one for ball, height in heights.items() for one in _drop(ball, height)]
        for index, (ball, height) in enumerate(heights.items()):
            kinetic, potential = readings[5 * index + 3], readings[5 * index + 4]
            share = _share(kinetic["kinetic_energy"] + potential["potential_energy"], height)
            bounds[ball][0 if share > SHARE else 1] = height
    yield [answer(max(BALLS, key=lambda ball: bounds[ball][0]))]


def theory(knobs):
    """The ball of the highest rank: each padding is as thick as its rank asks for."""
    return list(BALLS)[list(knobs["rank"]).index(2)]


def measure(engine, knobs):
    """The ball with the greatest such height, each found by a finer search in the engine."""
    start = engine.save()
    heights = {}
    for ball, x in BALLS.items():
        low, high = LOW, HIGH
        for _ in range(14):
            height = sqrt(low * high)
            engine.restore(start)
            engine.place(ball, np.array([x, 0.0, RADIUS + height]), {})
            engine.step(engine.whole_steps(_wait(height)))
            speed, place = engine.twist(ball).linear[2], engine.pose(ball).position[2]
            if _share(speed**2 / 2 + GRAVITY * place, height) > SHARE:
                low = height
            else:
                high = height
        heights[ball] = low
    return max(heights, key=lambda ball: heights[ball])
