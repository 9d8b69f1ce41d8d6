"""Scene 84: halve the range of slopes, each time with a ball that has not spun yet."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

ANGLES = tuple(range(8, 51, 3))
BALLS = ("object_1", "object_2", "object_3", "object_4")
RADIUS = 0.1
RUN_S = 0.5
SKIDS = 0.03
"""Share of the speed at the lowest point of the ball from which on it skids."""


def _place(number):
    """Middle of a ball that touches the slope at its marked point."""
    angle = radians(ANGLES[number - 1])
    return [RADIUS * sin(angle), 2.0 * number, 3.0 + RADIUS * cos(angle)]


def _skids(readings):
    """Compare ω R, with ω = 2 E / L, and the speed."""
    speed = float(np.linalg.norm(readings[2]["velocity"]))
    spin = 2 * readings[3]["rotational_energy"] / abs(readings[4]["angular_momentum"]["y"])
    return spin * RADIUS < (1 - SKIDS) * speed


def solve(task):
    """Slopes up to `rolls` are not too steep; on `skids` and beyond the ball skids."""
    rolls, skids = 0, len(ANGLES) + 1
    for ball in BALLS:
        if skids - rolls == 1:
            break
        number = (rolls + skids) // 2
        x, y, z = _place(number)
        readings = yield [
            call("move_object", object_id=ball, x=x, y=y, z=z),
            call("step", duration=RUN_S),
            call("get_velocity", object_id=ball),
            call("get_rotational_energy", object_id=ball, mass=1.0),
            call("get_angular_momentum", object_id=ball, mass=1.0),
        ]
        rolls, skids = (rolls, number) if _skids(readings) else (number, skids)
    yield [answer(str(skids))]


def theory(knobs):
    """The slope was drawn; the friction follows from it."""
    return str(knobs["first"])


def measure(engine, knobs):
    """A fresh ball on every slope in the engine."""
    for number in range(1, len(ANGLES) + 1):
        start = engine.save()
        engine.place("object_1", np.array(_place(number)), {})
        engine.step(engine.whole_steps(2 * RUN_S))
        twist = engine.twist("object_1")
        engine.restore(start)
        if abs(twist.angular[1]) * RADIUS < (1 - SKIDS) * np.linalg.norm(twist.linear):
            return str(number)
    return "0"
