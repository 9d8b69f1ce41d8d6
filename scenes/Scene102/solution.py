"""Scene 102: take the latch away, read the speed, and weigh the puck by its collision."""

from scenes.protocol import answer, call

KNOWN_KG = 1.0
FREE_S = 0.5
"""By then the spring has let go of the puck, and it has not reached the other one."""
HIT_S = 2.0
"""Time in which the slowest puck has hit the other one."""


def solve(task):
    """Mass from m (v - v') = M V, energy from m v² / 2."""
    readings = yield [
        call("delete_objects", object_id="object_2"),
        call("step", duration=FREE_S),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("step", duration=HIT_S),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("get_momentum", object_id="object_3", mass=KNOWN_KG),
    ]
    before, after, given = (reading["momentum"]["x"] for reading in (readings[2], *readings[4:]))
    yield [answer(given / (before - after) * before**2 / 2)]


def theory(knobs):
    """E = k x² / 2 = m v² / 2."""
    return knobs["m"] * knobs["v0"] ** 2 / 2


def measure(engine, knobs):
    """Kinetic energy of the released puck in the engine."""
    engine.remove("object_2")
    engine.step(engine.whole_steps(FREE_S))
    return float(knobs["m"] * engine.twist("object_1").linear[0] ** 2 / 2)
