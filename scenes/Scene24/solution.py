"""Scene 24: find the ball; its speed over its spin is the radius."""

from math import hypot

from scenes.protocol import answer, call


def solve(task):
    """Held by a rigid arm, the ball turns about itself as fast as about the axis: ω = 2 E / L, whatever its mass."""
    found = yield [call("find_objects")]
    ball = found[0]["revealed"][0]["object_id"]
    energy, spin, momentum = yield [
        call("get_rotational_energy", object_id=ball, mass=1.0),
        call("get_angular_momentum", object_id=ball, mass=1.0),
        call("get_momentum", object_id=ball, mass=1.0),
    ]
    rate = 2 * energy["rotational_energy"] / abs(spin["angular_momentum"]["z"])
    yield [answer(hypot(momentum["momentum"]["x"], momentum["momentum"]["y"]) / rate)]


def theory(knobs):
    """The radius that was drawn."""
    return knobs["r"]


def measure(engine, knobs):
    """From the centripetal acceleration: r = v² / a."""
    engine.step(20)
    speed, acceleration = engine.twist("object_2").linear, engine.acceleration("object_2")
    return float((speed @ speed) / (acceleration @ acceleration) ** 0.5)
