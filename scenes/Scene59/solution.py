"""Scene 59: what the push does not spend on the first block goes to the second."""

from scenes.protocol import answer, call

PUSH_N = 24.0
KNOWN_KG = 2.0
PUSH_S = 0.5


def solve(task):
    """Contact force N = F - m1 a."""
    readings = yield [
        call("apply_force", object_id="object_1", force_vector=[PUSH_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("compute_force", object_id="object_1", mass=KNOWN_KG),
    ]
    spent = readings[-1]["x"]
    yield [answer(PUSH_N - spent, acceleration=spent / KNOWN_KG)]


def theory(knobs):
    """Contact force N = F m2 / (m1 + m2)."""
    return PUSH_N * knobs["m2"] / (KNOWN_KG + knobs["m2"])


def measure(engine, knobs):
    """Contact force N = m2 a, from the speed the second block gains in the engine."""
    engine.push("object_1", force=[PUSH_N, 0.0, 0.0])
    engine.step(engine.whole_steps(PUSH_S))
    before = engine.twist("object_2").linear[0]
    engine.step(engine.whole_steps(PUSH_S))
    return float(knobs["m2"] * (engine.twist("object_2").linear[0] - before) / PUSH_S)
