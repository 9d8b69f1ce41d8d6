"""Scene 67: the same ball on each slope; the one that skids gets further."""

from math import cos, radians, sin

import numpy as np

from scenes.protocol import answer, call

SLOPES = {"object_1": -1.0, "object_2": 1.0}
TILT = radians(40)
RADIUS = 0.1
RUN_S = 0.7
ALIKE = 0.08


def _start(y):
    return [RADIUS * sin(TILT), y, RADIUS * cos(TILT)]


def _verdict(first, second):
    """The rougher slope's ball gets less far."""
    if abs(first - second) < ALIKE * max(first, second):
        return "0"
    return "object_1" if first < second else "object_2"


def solve(task):
    """One ball for each slope."""
    readings = yield [
        *(
            call("create_objects", name=f"ball{i}", pos=_start(y), density=1000, rgba=[1, 0, 0, 1], radius=RADIUS)
            for i, y in enumerate(SLOPES.values())
        ),
        call("step", duration=RUN_S),
        call("get_displacement", object_id="ball0"),
        call("get_displacement", object_id="ball1"),
    ]
    yield [answer(_verdict(readings[-2]["displacement"], readings[-1]["displacement"]))]


def theory(knobs):
    """The slope that was drawn."""
    return f"object_{knobs['rougher']}" if knobs["rougher"] else "0"


def measure(engine, knobs):
    """From the speeds of heavier balls in the engine."""
    for slope, y in SLOPES.items():
        engine.add_ball(f"on_{slope}", np.array(_start(y)), 3000.0, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(RUN_S))
    return _verdict(*(float(np.linalg.norm(engine.twist(f"on_{slope}").linear)) for slope in SLOPES))
