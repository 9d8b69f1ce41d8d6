"""Scene 86: throw, read how high the ball came, and correct the speed until it comes to the height asked for."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

MASS_KG = 1.0
TARGET = 3.0
LOOK_S = 0.05
LOOKS = 44
REST_S = 20.0
"""Enough to sink back to the stand through the thickest air."""
FIRST = 6.0
MOST = 60.0
ROUNDS = 9
NEAR = 0.008


def _throw(speed):
    """One throw, with the height of the ball (its potential energy for 1 kg and 1 m/s²) at short intervals."""
    looks = [call("step", duration=LOOK_S), call("get_potential_energy", object_id="object_1", mass=1.0, gravity=1.0)]
    return [
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, speed]),
        *(looks * LOOKS),
        call("step", duration=REST_S),
    ]


def _apex(heights):
    """Greatest height: of the parabola through the highest look and its neighbours."""
    top = max(range(1, len(heights) - 1), key=lambda look: heights[look])
    before, highest, after = heights[top - 1 : top + 2]
    return highest + (after - before) ** 2 / (8 * (2 * highest - before - after))


def solve(task):
    """Keep a speed that is too low and one that is too high; in between, take the apex as linear in v²."""
    low, near, high, far = 0.0, 0.0, MOST, None
    speed = FIRST
    for turn in range(ROUNDS):
        readings = yield _throw(speed)
        apex = _apex([0.0] + [one["potential_energy"] for one in readings if "potential_energy" in one])
        if abs(apex - TARGET) < NEAR:
            break
        if apex < TARGET:
            low, near = speed, apex
        else:
            high, far = speed, apex
        if far is None:
            speed = min(2.0 * speed, MOST)
        elif turn % 3 == 2:
            speed = (low + high) / 2
        else:
            speed = sqrt(low**2 + (TARGET - near) / (far - near) * (high**2 - low**2))
    yield [answer(MASS_KG * speed**2 / 2)]


def theory(knobs):
    """Backwards from rest at the apex, in s = sqrt(apex - z): v dv/dz = -(g + α v + β v² + κ (z - free) where taut)."""
    steps = 200
    span = sqrt(TARGET) / steps

    def slope(root, speed):
        # v is about proportional to s, so that dv/ds stays finite at the apex.
        pull = knobs["kappa"] * max(TARGET - root**2 - knobs["free"], 0.0)
        slowing = knobs["g"] + knobs["alpha"] * speed + knobs["beta"] * speed**2 + pull
        return 2 * root * slowing / speed

    pull = knobs["kappa"] * max(TARGET - knobs["free"], 0.0)
    root, speed = span, span * sqrt(2 * (knobs["g"] + pull))
    for _ in range(steps - 1):
        one = slope(root, speed)
        two = slope(root + span / 2, speed + span / 2 * one)
        root, speed = root + span, speed + span * two
    return MASS_KG * speed**2 / 2


def measure(engine, knobs):
    """The same speed by halving in the engine, whose ball must pass the height or turn below it."""
    start = engine.save()
    low, high = 0.0, MOST
    for _ in range(16):
        speed = (low + high) / 2
        engine.restore(start)
        engine.set_velocity("object_1", np.array([0.0, 0.0, speed]))
        height = 0.0
        while height < TARGET and (height == 0.0 or engine.twist("object_1").linear[2] > 0):
            engine.step(1)
            height = engine.pose("object_1").position[2]
        # The ball turns within the last step; what it lost since is second order in the step.
        low, high = (speed, high) if height < TARGET else (low, speed)
    return MASS_KG * ((low + high) / 2) ** 2 / 2
