"""Scene 95: the first ball that moves the block, and one heavier still: two equations for friction and inertia."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
BLOCK_KG, BASKET_KG, ASKED_KG = 5.0, 0.1, 3.0
RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
FIRST_KG, RAISE, MORE = 0.45, 1.25, 1.6
SETTLE_S, LOOK_S, STOP_S = 0.2, 0.2, 1.5
MOVES = 0.02
"""Speed that tells motion from creeping, m/s."""


def _load(name, mass, basket):
    """Lay a ball into the basket where it is now, and see how fast it gains speed."""
    x, y, z = basket
    place = [x, y, z + RADIUS + 0.001]
    return [
        call("create_objects", name=name, pos=place, density=mass / VOLUME, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=SETTLE_S),
        call("get_velocity", object_id="object_2"),
        call("step", duration=LOOK_S),
        call("get_velocity", object_id="object_2"),
        call("delete_objects", object_id=name),
        call("step", duration=STOP_S),
        call("get_position", object_id="object_2"),
    ]


def _gained(readings):
    return (readings[2]["velocity"][2] - readings[4]["velocity"][2]) / LOOK_S


def _tension(friction, carried):
    """With block and wheel together as `carried`: T = (m + b) (g - a)."""
    down = ASKED_KG + BASKET_KG
    return down * (GRAVITY - (down * GRAVITY - friction) / (down + carried))


def solve(task):
    """Both accelerations have the friction f and the carried mass S in them: S a + f = (m + b) (g - a)."""
    readings = yield [call("get_position", object_id="object_2")]
    basket, mass, tried = readings[0]["position"], FIRST_KG, 0
    while True:
        readings = yield _load(f"ball{tried}", mass, basket)
        basket, tried = readings[-1]["position"], tried + 1
        if -readings[4]["velocity"][2] > MOVES:
            break
        mass *= RAISE
    first = _gained(readings)
    readings = yield _load("last", MORE * mass, basket)
    second = _gained(readings)
    pulls = [(m + BASKET_KG) * (GRAVITY - a) for m, a in ((mass, first), (MORE * mass, second))]
    carried = (pulls[1] - pulls[0]) / (second - first)
    friction = pulls[0] - carried * first
    yield [answer([friction / (BLOCK_KG * GRAVITY), _tension(friction, carried)])]


def theory(knobs):
    """The coefficient that was drawn, and the tension that follows."""
    carried = BLOCK_KG + knobs["inertia"] / 0.2**2
    return [knobs["mu"], _tension(knobs["mu"] * BLOCK_KG * GRAVITY, carried)]


def measure(engine, knobs):
    """Tension and friction from the engine's own acceleration with the ball that is asked for."""
    x, y, z = engine.pose("object_2").position
    engine.add_ball("ball", np.array([x, y, z + RADIUS]), ASKED_KG / VOLUME, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(SETTLE_S))
    before = engine.twist("object_2").linear[2]
    engine.step(engine.whole_steps(LOOK_S))
    gained = float(before - engine.twist("object_2").linear[2]) / LOOK_S
    tension = (ASKED_KG + BASKET_KG) * (GRAVITY - gained)
    friction = tension - (BLOCK_KG + knobs["inertia"] / 0.2**2) * gained
    return [friction / (BLOCK_KG * GRAVITY), tension]
