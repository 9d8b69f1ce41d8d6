"""Scene 14: push both blocks for a second and compare where they are."""

from scenes.protocol import answer, call

BLOCKS = ("object_1", "object_2")
FORCE_N = 30.0
PUSH_S = 1.0
ALIKE = 0.02
"""Share of the longer way; unequal blocks differ by more than 5 %."""


def _verdict(first, second):
    """The block with the larger of two ways, or 0."""
    if abs(first - second) < ALIKE * max(first, second):
        return "0"
    return BLOCKS[0] if first > second else BLOCKS[1]


def solve(task):
    """The same push on both, then two displacements."""
    readings = yield [
        *(call("apply_force", object_id=block, force_vector=[FORCE_N, 0, 0]) for block in BLOCKS),
        call("step", duration=PUSH_S),
        *(call("get_displacement", object_id=block) for block in BLOCKS),
    ]
    yield [answer(_verdict(*(reading["displacement"] for reading in readings[-2:])))]


def theory(knobs):
    """The block that was drawn."""
    return f"object_{knobs['further']}" if knobs["further"] else "0"


def measure(engine, knobs):
    """Speeds after half the time in the engine: at a constant acceleration, in the ratio of the ways."""
    for block in BLOCKS:
        engine.push(block, force=[FORCE_N, 0.0, 0.0])
    engine.step(engine.whole_steps(PUSH_S / 2))
    return _verdict(*(float(engine.twist(block).linear[0]) for block in BLOCKS))
