"""Scene 9: let the load come to rest and read the sag."""

from scenes.protocol import answer, call

STIFFNESS = 200.0
GRAVITY = 9.81
REST_S = 15.0


def solve(task):
    """At rest the spring carries the load."""
    readings = yield [
        call("step", duration=REST_S),
        call("get_kinetic_energy", object_id="object_1", mass=1.0),
        call("get_displacement", object_id="object_1"),
    ]
    yield [answer(STIFFNESS * readings[-1]["displacement"] / GRAVITY)]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The engine's rest, waited for twice as long."""
    start = engine.pose("object_1").position[2]
    engine.step(engine.whole_steps(2 * REST_S))
    return float(STIFFNESS * (start - engine.pose("object_1").position[2]) / GRAVITY)
