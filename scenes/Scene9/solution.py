"""Scene 9: let the load come to rest, see that it does rest, and read the sag."""

from scenes.protocol import answer, call

STIFFNESS = 200.0
GRAVITY = 9.81
REST_S = 15.0
STILL = 1e-3
"""Net force on a kilogram [N] below which the load is taken to rest."""


def _height():
    """The potential energy of one newton of weight is its height."""
    return call("get_potential_energy", object_id="object_1", mass=1.0, gravity=1.0)


def solve(task):
    """At rest, where no net force acts, the spring carries the load."""
    readings = yield [
        _height(),
        call("step", duration=REST_S),
        call("compute_force", object_id="object_1", mass=1.0),
        _height(),
    ]
    sag = readings[0]["potential_energy"] - readings[-1]["potential_energy"]
    rests = abs(readings[2]["z"]) < STILL
    yield [answer(STIFFNESS * sag / GRAVITY if rests else "the load still moves")]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """The engine's rest, waited for twice as long."""
    start = engine.pose("object_1").position[2]
    engine.step(engine.whole_steps(2 * REST_S))
    return float(STIFFNESS * (start - engine.pose("object_1").position[2]) / GRAVITY)
