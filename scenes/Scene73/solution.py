"""Scene 73: momentum weighs the ram, and with it the energy at equal velocities follows."""

from scenes.protocol import answer, call

GLIDER_KG = 2.0
SPEED = 3.0
RUN_S = 3.0


def _stored(mass, glider):
    """Energy of the motion relative to each other: m M / (m + M) v² / 2."""
    return mass * glider / (mass + glider) * SPEED**2 / 2


def solve(task):
    """Find it, send it, read both momenta."""
    found = yield [call("find_objects"), call("get_parameters", object_id="object_1")]
    ram, glider = found[0]["revealed"][0]["object_id"], found[1]["mass"]
    readings = yield [
        call("set_velocity", object_id=ram, velocity_vector=[SPEED, 0, 0]),
        call("step", duration=RUN_S),
        call("get_momentum", object_id="object_1", mass=glider),
        call("get_momentum", object_id=ram, mass=1.0),
    ]
    mass = readings[-2]["momentum"]["x"] / (SPEED - readings[-1]["momentum"]["x"])
    yield [answer([mass, _stored(mass, glider)])]


def theory(knobs):
    """The mass that was drawn, and the energy that belongs to it."""
    return [knobs["m"], _stored(knobs["m"], GLIDER_KG)]


def measure(engine, knobs):
    """The greatest spring energy in the engine, and the mass from its momenta."""
    engine.set_velocity("object_2", [SPEED, 0.0, 0.0])
    closest = 10.0
    for _ in range(engine.whole_steps(RUN_S)):
        engine.step(1)
        closest = min(closest, float(engine.pose("object_1").position[0] - engine.pose("object_2").position[0]))
    given, kept = (float(engine.twist(body).linear[0]) for body in ("object_1", "object_2"))
    return [GLIDER_KG * given / (SPEED - kept), knobs["k"] * (0.6 - closest) ** 2 / 2]
