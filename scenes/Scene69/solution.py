"""Scene 69: a ball in the cup slows the table down; the angular momentum stays."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
BALL_KG = 1.2
DENSITY = BALL_KG / (4 / 3 * pi * RADIUS**3)
PLACE = [0.5, 0.0, 1.0 + RADIUS]
CARRY_S = 6.0


def _inertia(first, second, place):
    """From I ω0 = (I + m r² + 2 m b² / 5) ω1."""
    added = BALL_KG * (place[0] ** 2 + place[1] ** 2 + 0.4 * RADIUS**2)
    return added * second / (first - second)


def _look():
    return [
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]


def _rate(energy, spin):
    """With one mass in both, ω = 2 E / L."""
    return 2 * energy["rotational_energy"] / spin["angular_momentum"]["z"]


def solve(task):
    """Angular speed before and after, and where the ball lies."""
    readings = yield [
        *_look(),
        call("create_objects", name="rider", pos=PLACE, density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=CARRY_S),
        *_look(),
        call("get_position", object_id="rider"),
    ]
    yield [answer(_inertia(_rate(*readings[:2]), _rate(*readings[4:6]), readings[-1]["position"]))]


def theory(knobs):
    """The inertia that was drawn."""
    return knobs["inertia"]


def measure(engine, knobs):
    """The same with the engine's own angular speeds, after twice the time."""
    first = float(engine.twist("object_1").angular[2])
    engine.add_ball("rider", np.array(PLACE), DENSITY, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(2 * CARRY_S))
    return float(_inertia(first, engine.twist("object_1").angular[2], engine.pose("rider").position))
