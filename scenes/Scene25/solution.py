"""Scene 25: find the other balls and watch all three fall for ten seconds."""

from scenes.protocol import answer, call

BALLS = ("object_1", "object_2", "object_3")
FALL_S = 10.0
ALIKE_M = 0.05
ALIKE_SPEED = 0.01


def _furthest(values, alike):
    """The ball with the largest value, or 0 if all are alike."""
    return "0" if max(values) - min(values) < alike else BALLS[values.index(max(values))]


def solve(task):
    """Displacement from the common height is the way fallen."""
    readings = yield [
        call("find_objects"),
        call("step", duration=FALL_S),
        *(call("get_displacement", object_id=ball) for ball in BALLS),
    ]
    yield [answer(_furthest([reading["displacement"] for reading in readings[2:]], ALIKE_M))]


def theory(knobs):
    """The heaviest ball."""
    return f"object_{knobs['lowest']}" if knobs["lowest"] else "0"


def measure(engine, knobs):
    """In the engine: the ball that is fastest once their speeds are steady has always been."""
    engine.step(engine.whole_steps(FALL_S / 2))
    return _furthest([-float(engine.twist(ball).linear[2]) for ball in BALLS], ALIKE_SPEED)
