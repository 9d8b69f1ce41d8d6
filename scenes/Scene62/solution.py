"""Scene 62: momentum gives the ratio of the masses, the speeds then the energies."""

from scenes.protocol import answer, call

SPEED = 2.0
RUN_S = 1.5


def solve(task):
    """The ratio m2 / m1 = (v - v1) / v2."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("get_kinetic_energy", object_id="object_1", mass=1.0),
        call("step", duration=RUN_S),
        call("get_velocity", object_id="object_1"),
        call("get_velocity", object_id="object_2"),
        call("get_kinetic_energy", object_id="object_1", mass=1.0),
        call("get_kinetic_energy", object_id="object_2", mass=1.0),
    ]
    first, second = (reading["velocity"][0] for reading in readings[3:5])
    ratio = (SPEED - first) / second
    before, after, given = (readings[i]["kinetic_energy"] for i in (1, 5, 6))
    yield [answer(1 - (after + ratio * given) / before, mass_ratio=ratio)]


def measure(engine, knobs):
    """From the engine's speeds and the true masses."""
    engine.set_velocity("object_1", [SPEED, 0.0, 0.0])
    engine.step(engine.whole_steps(RUN_S))
    first, second = (float(engine.twist(body).linear[0]) for body in ("object_1", "object_2"))
    return 1 - (knobs["m1"] * first**2 + knobs["m2"] * second**2) / (knobs["m1"] * SPEED**2)
