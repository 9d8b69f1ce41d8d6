"""Scene 109: take one hook away and wait for the new rest."""

from scenes.protocol import answer, call

WEIGHT_N = 2.0 * 9.81
REST_S = 30.0


def solve(task):
    """The load sinks by what the lost spring had carried."""
    readings = yield [
        call("delete_objects", object_id="object_3"),
        call("step", duration=REST_S),
        call("get_displacement", object_id="object_1"),
    ]
    yield [answer(readings[-1]["displacement"])]


def theory(knobs):
    """The load hangs lower by m g / (s K) - m g / K."""
    return WEIGHT_N / knobs["K"] * (1 / knobs["share"] - 1)


def measure(engine, knobs):
    """The engine's own rest, waited for longer."""
    start = engine.pose("object_1").position[2]
    engine.remove("object_3")
    engine.step(engine.whole_steps(2 * REST_S))
    return float(start - engine.pose("object_1").position[2])
