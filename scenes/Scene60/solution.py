"""Scene 60: how slowly the weights start tells the wheel's inertia."""

from scenes.protocol import answer, call

LIGHT_KG, HEAVY_KG = 1.0, 2.0
GRAVITY = 9.81
RADIUS = 0.2
RUN_S = 0.5


def _inertia(acceleration):
    """From (m2 - m1) g = (m1 + m2 + I / R²) a."""
    return RADIUS**2 * ((HEAVY_KG - LIGHT_KG) * GRAVITY / acceleration - LIGHT_KG - HEAVY_KG)


def solve(task):
    """From the displacement: a = 2 s / t²."""
    readings = yield [call("step", duration=RUN_S), call("get_displacement", object_id="object_1")]
    yield [answer(_inertia(2 * readings[-1]["displacement"] / RUN_S**2))]


def theory(knobs):
    """The inertia that was drawn."""
    return knobs["inertia"]


def measure(engine, knobs):
    """From the speed in the engine."""
    engine.step(engine.whole_steps(2 * RUN_S))
    return _inertia(float(engine.twist("object_1").linear[2]) / (2 * RUN_S))
