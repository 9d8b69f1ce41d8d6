"""Scene 23: push the pad with a known force and read how far it gives way."""

from scenes.protocol import answer, call

FORCE_N = 20.0
REST_S = 15.0


def solve(task):
    """Reveal, push, wait, read."""
    found = yield [call("find_objects")]
    pad = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("apply_force", object_id=pad, force_vector=[0, 0, -FORCE_N]),
        call("step", duration=REST_S),
        call("get_displacement", object_id=pad),
    ]
    yield [answer(FORCE_N / readings[-1]["displacement"])]


def theory(knobs):
    """The stiffness that was drawn."""
    return knobs["k"]


def measure(engine, knobs):
    """The engine's rest under twice the force, waited for longer."""
    start = engine.pose("object_2").position[2]
    engine.push("object_2", force=[0.0, 0.0, 2 * FORCE_N])
    engine.step(engine.whole_steps(2 * REST_S))
    return float(2 * FORCE_N / (engine.pose("object_2").position[2] - start))
