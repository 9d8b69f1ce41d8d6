"""Scene 11: let the slider go and read its speed after a second."""

from math import cos, hypot, radians, sin

from scenes.protocol import answer, call

GRAVITY = 9.81
SLOPE = radians(30)
SLIDE_S = 1.0


def _friction(acceleration):
    """From a = g (sin θ - μ cos θ)."""
    return (sin(SLOPE) - acceleration / GRAVITY) / cos(SLOPE)


def solve(task):
    """From rest, a = v / t."""
    readings = yield [call("step", duration=SLIDE_S), call("get_velocity", object_id="object_1")]
    vx, _, vz = readings[-1]["velocity"]
    yield [answer(_friction(hypot(vx, vz) / SLIDE_S))]


def theory(knobs):
    """The coefficient that was drawn."""
    return knobs["mu"]


def measure(engine, knobs):
    """From the distance the engine's slider comes in the second second."""
    engine.step(engine.whole_steps(SLIDE_S))
    before = engine.twist("object_1").linear
    engine.step(engine.whole_steps(SLIDE_S))
    change = engine.twist("object_1").linear - before
    return _friction(hypot(change[0], change[2]) / SLIDE_S)
