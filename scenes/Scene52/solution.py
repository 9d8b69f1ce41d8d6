"""Scene 52: let the plank go and see which way its right end moves."""

from scenes.protocol import answer, call

WATCH_S = 1.0
LEVEL_M = 1e-3


def _verdict(risen):
    return "0" if abs(risen) < LEVEL_M else "1" if risen > 0 else "2"


def solve(task):
    """The right end rises if the left side sinks."""
    readings = yield [
        call("get_position", object_id="object_1"),
        call("step", duration=WATCH_S),
        call("get_position", object_id="object_1"),
    ]
    yield [answer(_verdict(readings[2]["position"][2] - readings[0]["position"][2]))]


def theory(knobs):
    """The side that was drawn."""
    return str(knobs["sinks"])


def measure(engine, knobs):
    """Where the plank's end is after three times as long."""
    start = engine.pose("object_1").position[2]
    engine.step(engine.whole_steps(3 * WATCH_S))
    return _verdict(engine.pose("object_1").position[2] - start)
