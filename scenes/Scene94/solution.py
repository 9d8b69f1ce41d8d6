"""Scene 94: the speeds given by balls of three masses tell the best mass; then three masses around it."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
START, MIDDLE = {"x": -1.5, "y": 0, "z": 1}, [0.0, 0.0, 1.0]
SPEED = 2.0
FIRST_GUESS = 2.0
SHARES = (0.3, 1.0, 3.0)
ROUNDS = 3
RUN_S = 0.65
"""The ball is hit after 0.65 s."""
LOOK_S, LOOKS = 0.05, 102
THROWN_S = 0.24
"""A hit lasts about 0.1 s; within this time after the first stir no second hit can come."""
CALM_S = 50.0


def _run(mass, name):
    """One shot at a ball of this mass; then everything as before."""
    return [
        call("create_objects", name=name, pos=MIDDLE, density=mass / VOLUME, rgba=[0, 1, 0, 1], radius=RADIUS),
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=RUN_S),
        *([call("step", duration=LOOK_S), call("get_velocity", object_id="object_2")] * LOOKS),
        call("delete_objects", object_id=name),
        call("move_object", object_id="object_1", **START),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("step", duration=CALM_S),
    ]


def _thrown(readings):
    """Greatest speed of the far cart during the hit that first stirs it; then the spring slows it."""
    speeds = [one["velocity"][0] for one in readings[4:-4:2]]
    stirred = next(at for at, speed in enumerate(speeds) if speed > 1e-3)
    return max(speeds[stirred : stirred + round(THROWN_S / LOOK_S)])


def _best(masses, speeds):
    """1 / speed is a m + b + c / m, least at √(c / a)."""
    m = np.array(masses)
    a, _, c = np.linalg.solve(np.column_stack([m, np.ones(3), 1 / m]), 1 / np.array(speeds))
    return sqrt(max(c / a, 1e-2))


def solve(task):
    """Masses around what seemed best so far, again and again."""
    guess = FIRST_GUESS
    for turn in range(ROUNDS):
        masses, speeds = [share * guess for share in SHARES], []
        for nth, mass in enumerate(masses):
            speeds.append(_thrown((yield _run(mass, f"ball{turn}_{nth}"))))
        guess = min(max(_best(masses, speeds), 0.2), 20.0)
    yield [answer(guess)]


def theory(knobs):
    """Geometric mean of the carts' masses."""
    return sqrt(knobs["m1"] * knobs["m2"])


def measure(engine, knobs):
    """Three masses close around the best in the engine, and the law through them."""
    start, best = engine.save(), theory(knobs)
    masses, speeds = [share * best for share in (0.4, 1.0, 2.5)], []
    for nth, mass in enumerate(masses):
        engine.restore(start)
        engine.add_ball(f"ball{nth}", np.array(MIDDLE), mass / VOLUME, RADIUS, np.ones(4), {})
        engine.set_velocity("object_1", np.array([SPEED, 0.0, 0.0]))
        speed = 0.0
        while speed < 1e-6:
            engine.step(1)
            speed = float(engine.twist("object_2").linear[0])
        for _ in range(engine.whole_steps(THROWN_S)):
            engine.step(1)
            speed = max(speed, float(engine.twist("object_2").linear[0]))
        speeds.append(speed)
    return _best(masses, speeds)
