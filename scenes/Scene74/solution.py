"""Scene 74: what the hidden slider loses in height and does not gain in speed is heat."""

from math import cos, radians, sin

from scenes.protocol import answer, call

GRAVITY = 9.81
SLIDE_S = 0.8
MASS_KG = 3.0


def solve(task):
    """The mass can be read once the slider is found."""
    found = yield [call("find_objects")]
    slider = found[0]["revealed"][0]["object_id"]
    looked = yield [call("get_parameters", object_id=slider)]
    mass = looked[0]["mass"]
    readings = yield [
        call("get_potential_energy", object_id=slider, mass=mass),
        call("step", duration=SLIDE_S),
        call("get_potential_energy", object_id=slider, mass=mass),
        call("get_kinetic_energy", object_id=slider, mass=mass),
    ]
    lost = readings[0]["potential_energy"] - readings[2]["potential_energy"]
    yield [answer(lost - readings[3]["kinetic_energy"])]


def theory(knobs):
    """Friction force times way, f a t² / 2."""
    angle = radians(knobs["angle"])
    friction = knobs["mu"] * MASS_KG * GRAVITY * cos(angle)
    return friction * (GRAVITY * sin(angle) - friction / MASS_KG) * SLIDE_S**2 / 2


def measure(engine, knobs):
    """The engine's way, times the force that its acceleration leaves missing."""
    start = engine.pose("object_2").position
    engine.step(engine.whole_steps(SLIDE_S))
    way = float(((engine.pose("object_2").position - start) ** 2).sum() ** 0.5)
    gained = float((engine.twist("object_2").linear ** 2).sum() ** 0.5) / SLIDE_S
    return MASS_KG * (GRAVITY * sin(radians(knobs["angle"])) - gained) * way
