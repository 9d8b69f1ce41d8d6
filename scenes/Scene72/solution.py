"""Scene 72: reveal the weight and read how fast it gains speed."""

from scenes.protocol import answer, call

GRAVITY = 9.81
CART_KG = 3.0
FRICTION_N = 0.2 * CART_KG * GRAVITY
RUN_S = 0.3


def _mass(gained):
    """From m g - μ M g = (m + M) a."""
    return (CART_KG * gained + FRICTION_N) / (GRAVITY - gained)


def solve(task):
    """Find it, let it fall, read."""
    found = yield [call("find_objects")]
    weight = found[0]["revealed"][0]["object_id"]
    readings = yield [call("step", duration=RUN_S), call("get_velocity", object_id=weight)]
    yield [answer(_mass(-readings[-1]["velocity"][2] / RUN_S))]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """From the cart's own way in the engine: a = 2 s / t²."""
    start = engine.pose("object_1").position[0]
    engine.step(engine.whole_steps(RUN_S))
    return float(_mass(2 * (engine.pose("object_1").position[0] - start) / RUN_S**2))
