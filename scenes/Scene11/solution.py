"""Scene 11: let the slider go and read its acceleration."""

from math import cos, hypot, radians, sin

from scenes.protocol import answer, call

GRAVITY = 9.81
SLOPE = radians(30)
SLIDE_S = 1.0


def _friction(acceleration):
    """From a = g (sin θ - μ cos θ)."""
    return (sin(SLOPE) - acceleration / GRAVITY) / cos(SLOPE)


def solve(task):
    """The acceleration is the same all the way."""
    readings = yield [call("step", duration=SLIDE_S), call("get_acceleration", object_id="object_1")]
    yield [answer(_friction(hypot(readings[-1]["x"], readings[-1]["z"])))]


def theory(knobs):
    """The coefficient that was drawn."""
    return knobs["mu"]


def measure(engine, knobs):
    """From the distance in the engine: a = 2 s / t²."""
    start = engine.pose("object_1").position
    engine.step(engine.whole_steps(2 * SLIDE_S))
    run = engine.pose("object_1").position - start
    return _friction(2 * hypot(run[0], run[2]) / (2 * SLIDE_S) ** 2)
