"""Scene 57: push the long block for half a second and compare how far both have come."""

from scenes.protocol import answer, call

OUTCOMES = ("neither block moves", "both blocks move together", "the small block lags behind")
FORCE_N = 20.0
PUSH_S = 0.5
STILL_M = 0.005
TOGETHER = 0.05


def _verdict(lower, upper):
    if lower < STILL_M:
        return OUTCOMES[0]
    return OUTCOMES[1] if lower - upper < TOGETHER * lower else OUTCOMES[2]


def solve(task):
    """One push, two displacements."""
    readings = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("get_displacement", object_id="object_1"),
        call("get_displacement", object_id="object_2"),
    ]
    yield [answer(_verdict(readings[2]["displacement"], readings[3]["displacement"]))]


def theory(knobs):
    """The outcome that was drawn."""
    return OUTCOMES[knobs["outcome"]]


def measure(engine, knobs):
    """From the ways of both blocks in the engine after four fifths of the time."""
    bodies = ("object_1", "object_2")
    before = [engine.pose(body).position[0] for body in bodies]
    engine.push("object_1", force=[FORCE_N, 0.0, 0.0])
    engine.step(engine.whole_steps(0.8 * PUSH_S))
    return _verdict(*(float(engine.pose(body).position[0] - x) for body, x in zip(bodies, before, strict=True)))
