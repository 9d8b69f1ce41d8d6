"""Scene 70: set a ball into the cup and see whether the left end rises or sinks."""

import numpy as np

from scenes.protocol import answer, call

OUTCOMES = ("it stays level", "its left end rises", "its left end sinks")
RADIUS = 0.1
PLACE = [0.3, 0.0, 1.03 + RADIUS]
START_Z = 1.0
STILL_M = 5e-4
REST_S = 3.0


def _verdict(risen):
    """The left end rises if the ball turns the bar down on the right of the axis."""
    return OUTCOMES[0] if abs(risen) < STILL_M else OUTCOMES[1] if risen > 0 else OUTCOMES[2]


def solve(task):
    """One ball, one look at the left end."""
    readings = yield [
        call("create_objects", name="weight", pos=PLACE, density=1000, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=REST_S),
        call("get_position", object_id="object_1"),
    ]
    yield [answer(_verdict(readings[-1]["position"][2] - START_Z))]


def theory(knobs):
    """The side that was drawn."""
    return OUTCOMES[knobs["side"]]


def measure(engine, knobs):
    """The same with a lighter ball, by the bar's own end."""
    engine.add_ball("weight", np.array(PLACE), 500.0, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(REST_S))
    return _verdict(engine.pose("object_1").position[2] - START_Z)
