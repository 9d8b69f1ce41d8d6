"""Scene 10: let the weights go and read the acceleration."""

from scenes.protocol import answer, call

GRAVITY = 9.81
RUN_S = 0.5


def solve(task):
    """The acceleration is the same all the way."""
    readings = yield [call("step", duration=RUN_S), call("get_acceleration", object_id="object_1")]
    yield [answer(readings[-1]["z"])]


def theory(knobs):
    """Atwood: a = g (m2 - m1) / (m1 + m2)."""
    return GRAVITY * (knobs["m2"] - knobs["m1"]) / (knobs["m1"] + knobs["m2"])


def measure(engine, knobs):
    """From the distance: a = 2 s / t²."""
    start = engine.pose("object_1").position[2]
    engine.step(engine.whole_steps(1.0))
    return float(2 * (engine.pose("object_1").position[2] - start))
