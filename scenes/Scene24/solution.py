"""Scene 24: compare how fast the ball is with how fast its velocity turns."""

from math import atan2, hypot

from scenes.protocol import answer, call

LOOK_S = 0.1


def solve(task):
    """Radius r = v Δt / Δφ, with the angle Δφ by which the velocity turns in Δt."""
    found = yield [call("find_objects")]
    ball = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("get_momentum", object_id=ball, mass=1.0),
        call("step", duration=LOOK_S),
        call("get_momentum", object_id=ball, mass=1.0),
    ]
    before, after = readings[0]["momentum"], readings[2]["momentum"]
    turned = atan2(
        before["x"] * after["y"] - before["y"] * after["x"], before["x"] * after["x"] + before["y"] * after["y"]
    )
    yield [answer(hypot(after["x"], after["y"]) * LOOK_S / abs(turned))]


def theory(knobs):
    """The radius that was drawn."""
    return knobs["r"]


def measure(engine, knobs):
    """From the engine's acceleration: r = v² / a."""
    engine.step(1)
    speed = hypot(*engine.twist("object_2").linear[:2])
    return float(speed**2 / hypot(*engine.acceleration("object_2")[:2]))
