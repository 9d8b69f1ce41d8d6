"""Scene 8: let both balls roll for a second; the thin-walled one is behind."""

from scenes.protocol import answer, call

BALLS = ("object_1", "object_2")
ROLL_S = 1.0
ALIKE = 0.05
"""The two kinds differ by a sixth in acceleration."""


def _verdict(first, second):
    """The one that comes less far, or 0."""
    if abs(first - second) < ALIKE * max(first, second):
        return "0"
    return BALLS[0] if first < second else BALLS[1]


def solve(task):
    """One second, two displacements."""
    readings = yield [call("step", duration=ROLL_S), *(call("get_displacement", object_id=ball) for ball in BALLS)]
    yield [answer(_verdict(readings[1]["displacement"], readings[2]["displacement"]))]


def theory(knobs):
    """The ball that was drawn."""
    return f"object_{knobs['which']}" if knobs["which"] else "0"


def measure(engine, knobs):
    """Speeds after half a second in the engine."""
    engine.step(engine.whole_steps(ROLL_S / 2))
    return _verdict(*(float((engine.twist(ball).linear ** 2).sum() ** 0.5) for ball in BALLS))
