"""Scene 25: let all three fall and see which is lowest."""

from scenes.protocol import answer, call

FALL_S = 10.0
LEVEL = 0.02
"""Falls that differ by less than this share are alike."""
BALLS = ("object_1", "object_2", "object_3")


def _verdict(falls):
    if max(falls) - min(falls) < LEVEL * max(falls):
        return "0"
    return BALLS[falls.index(max(falls))]


def solve(task):
    """Reveal, wait, compare."""
    yield [call("find_objects")]
    readings = yield [call("step", duration=FALL_S), *(call("get_displacement", object_id=ball) for ball in BALLS)]
    yield [answer(_verdict([reading["displacement"] for reading in readings[1:]]))]


def theory(knobs):
    """The ball that was drawn."""
    return f"object_{knobs['lowest']}" if knobs["lowest"] else "0"


def measure(engine, knobs):
    """Speeds after two thirds of the time in the engine."""
    engine.step(engine.whole_steps(FALL_S * 2 / 3))
    return _verdict([float(-engine.twist(ball).linear[2]) for ball in BALLS])
