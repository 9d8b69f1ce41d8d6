"""Scene 12: let the ball fall and read how fast it drifts."""

from scenes.protocol import answer, call

FALL_S = 0.5
HIGH = 25.0
"""Far from the floor [m]."""


def solve(task):
    """Let go from a greater height, to be safe from the floor, the ball lags behind the wagon."""
    readings = yield [
        call("move_object", object_id="object_1", x=0, y=0, z=HIGH),
        call("step", duration=FALL_S),
        call("get_momentum", object_id="object_1", mass=1.0),
    ]
    yield [answer(-readings[-1]["momentum"]["x"] / FALL_S)]


def theory(knobs):
    """The acceleration that was drawn."""
    return knobs["a"]


def measure(engine, knobs):
    """From the distance: a = -2 x / t²."""
    engine.step(engine.whole_steps(1.0))
    return float(-2 * engine.pose("object_1").position[0])
