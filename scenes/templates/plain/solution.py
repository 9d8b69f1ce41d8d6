"""Scene SCENE_ID: push the cart with a known force and read its speed."""

from scenes.protocol import answer, call

FORCE_N = 4.0
PUSH_S = 1.0


def solve(task):
    """One push, one reading."""
    readings = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("get_velocity", object_id="object_1"),
    ]
    yield [answer(FORCE_N * PUSH_S / readings[-1]["velocity"][0])]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The same push in the engine."""
    engine.push("object_1", force=[FORCE_N, 0.0, 0.0])
    engine.step(engine.whole_steps(PUSH_S))
    return float(FORCE_N * PUSH_S / engine.twist("object_1").linear[0])
