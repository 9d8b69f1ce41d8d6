"""Scene 22: send the hidden puck against the visible one and read the latter's speed."""

from scenes.protocol import answer, call

SPEED = 3.0
RUN_S = 1.5


def solve(task):
    """Reveal, send, read."""
    found = yield [call("find_objects")]
    hidden = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("set_velocity", object_id=hidden, velocity_vector=[SPEED, 0, 0]),
        call("step", duration=RUN_S),
        call("get_velocity", object_id="object_1"),
    ]
    yield [answer(readings[-1]["velocity"][0])]


def measure(engine, knobs):
    """From the momentum that the hidden puck has lost in the engine."""
    engine.set_velocity("object_2", [SPEED, 0.0, 0.0])
    engine.step(engine.whole_steps(RUN_S))
    return float(knobs["m"] * (SPEED - engine.twist("object_2").linear[0]) / 2.0)
