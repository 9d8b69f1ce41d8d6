"""Scene 12: let the ball fall and read how fast it drifts."""

from scenes.protocol import answer, call

FALL_S = 0.5


def solve(task):
    """The ball lags behind the wagon."""
    readings = yield [call("step", duration=FALL_S), call("get_momentum", object_id="object_1", mass=1.0)]
    yield [answer(-readings[-1]["momentum"]["x"] / FALL_S)]


def theory(knobs):
    """The acceleration that was drawn."""
    return knobs["a"]


def measure(engine, knobs):
    """From the distance: a = -2 x / t²."""
    engine.step(engine.whole_steps(1.0))
    return float(-2 * engine.pose("object_1").position[0])
