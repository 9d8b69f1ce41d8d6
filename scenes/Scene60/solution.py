"""Scene 60: what the sinking weights lose and do not have, the wheel has."""

from scenes.protocol import answer, call

LIGHT_KG, HEAVY_KG = 1.0, 2.0
GRAVITY = 9.81
RADIUS = 0.2
RUN_S = 1.0


def _inertia(acceleration):
    """From (m2 - m1) g = (m1 + m2 + I / R²) a."""
    return RADIUS**2 * ((HEAVY_KG - LIGHT_KG) * GRAVITY / acceleration - LIGHT_KG - HEAVY_KG)


def solve(task):
    """The way that both weights' centre of mass sinks gives the work of gravity: (m1 + m2 + I / R²) v² / 2."""
    readings = yield [
        call("get_center_of_mass"),
        call("step", duration=RUN_S),
        call("get_center_of_mass"),
        call("get_momentum", object_id="object_1", mass=1.0),
    ]
    sunk = readings[0]["center_of_mass"]["z"] - readings[2]["center_of_mass"]["z"]
    way = sunk * (LIGHT_KG + HEAVY_KG) / (HEAVY_KG - LIGHT_KG)
    yield [answer(_inertia(readings[3]["momentum"]["z"] ** 2 / (2 * way)))]


def theory(knobs):
    """The inertia that was drawn."""
    return knobs["inertia"]


def measure(engine, knobs):
    """From the speed in the engine."""
    engine.step(engine.whole_steps(2 * RUN_S))
    return _inertia(float(engine.twist("object_1").linear[2]) / (2 * RUN_S))
