"""Scene SCENE_ID: find what is hidden, push it with a known force and read its speed."""

from scenes.protocol import answer, call

FORCE_N = 4.0
PUSH_S = 1.0


def solve(task):
    """Reveal the hidden object, push it once and read its speed."""
    found = yield [call("find_objects")]
    hidden = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("apply_force", object_id=hidden, force_vector=[FORCE_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("get_velocity", object_id=hidden),
    ]
    yield [answer(FORCE_N * PUSH_S / readings[-1]["velocity"][0])]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The same push in the engine."""
    engine.push("object_2", force=[FORCE_N, 0.0, 0.0])
    engine.step(engine.whole_steps(PUSH_S))
    return float(FORCE_N * PUSH_S / engine.twist("object_2").linear[0])
