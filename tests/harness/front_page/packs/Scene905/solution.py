"""Scene 905: let the red cart hit the blue one, and find its mass from the momentum that it receives."""

from scenes.protocol import answer, call

RED_KG = 1.0
PUSH_N, PUSH_S = 3.0, 0.5
RUN_S = 1.0


def solve(task):
    """Push the red cart and read its velocity; let the carts collide and read both."""
    (*_, before) = yield [
        call("apply_force", object_id="object_1", force_vector=[PUSH_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        call("get_velocity", object_id="object_1"),
    ]
    (_, red, blue) = yield [
        call("step", duration=RUN_S),
        call("get_velocity", object_id="object_1"),
        call("get_velocity", object_id="object_2"),
    ]
    change = before["velocity"][0] - red["velocity"][0]
    yield [answer(round(RED_KG * change / blue["velocity"][0], 3))]


def theory(knobs):
    """The hidden mass."""
    return float(knobs["m"])


def measure(engine, knobs):
    """Compute the mass from the momentum that the red cart loses in the engine."""
    engine.set_velocity("object_1", [1.5, 0.0, 0.0])
    engine.step(engine.whole_steps(PUSH_S + RUN_S))
    return float(RED_KG * (1.5 - engine.twist("object_1").linear[0]) / engine.twist("object_2").linear[0])
