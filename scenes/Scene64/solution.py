"""Scene 64: how far the puck comes tells what friction takes from the spring's energy."""

from scenes.protocol import answer, call

STORED_J = 500.0 * 0.15**2 / 2
WEIGHT_N = 9.81
SLIDE_S = 6.0


def solve(task):
    """All of the spring's energy is spent on the way."""
    readings = yield [
        call("get_center_of_mass"),
        call("step", duration=SLIDE_S),
        call("get_kinetic_energy", object_id="object_1", mass=1.0),
        call("get_center_of_mass"),
    ]
    way = readings[3]["center_of_mass"]["x"] - readings[0]["center_of_mass"]["x"]
    yield [answer((STORED_J - readings[2]["kinetic_energy"]) / (WEIGHT_N * way))]


def theory(knobs):
    """The coefficient that was drawn."""
    return knobs["mu"]


def measure(engine, knobs):
    """From the engine's slowing after the spring has let go."""
    engine.step(engine.whole_steps(0.2))
    return float(-engine.acceleration("object_1")[0] / WEIGHT_N)
