"""Scene 101: weigh the first block alone, then the pair."""

import numpy as np

from scenes.protocol import answer, call

FORCE_N = 12.0
PUSH_S = 0.2


def solve(task):
    """Push block 1 alone; stop it and put it back; join the two; push again and see what is left for block 1."""
    alone = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("get_momentum", object_id="object_1", mass=1.0),
    ]
    first = FORCE_N * PUSH_S / alone[-1]["momentum"]["x"]
    pair = yield [
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("move_object", object_id="object_1", x=0, y=0, z=1),
        call("attach_objects", object1_id="object_1", object2_id="object_2", joint="weld"),
        call("apply_force", object_id="object_1", force_vector=[FORCE_N, 0, 0]),
        call("step", duration=PUSH_S),
        call("get_acceleration", object_id="object_1"),
        call("compute_force", object_id="object_1", mass=first),
    ]
    yield [answer([pair[-2]["x"], FORCE_N - pair[-1]["x"]])]


def theory(knobs):
    """A = F / (m1 + m2), and m2 a is passed on."""
    acceleration = FORCE_N / (knobs["m1"] + knobs["m2"])
    return [acceleration, knobs["m2"] * acceleration]


def measure(engine, knobs):
    """The engine's pair, joined at the start."""
    engine.join("object_1", "object_2", "weld")
    engine.push("object_1", force=np.array([FORCE_N, 0.0, 0.0]))
    engine.step(engine.whole_steps(1.0))
    acceleration = float(engine.twist("object_2").linear[0])
    return [acceleration, knobs["m2"] * acceleration]
