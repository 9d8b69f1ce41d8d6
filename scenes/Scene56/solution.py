"""Scene 56: the ball tells how heavy things are in this lift, the scale what the load weighs there."""

from scenes.protocol import answer, call

STIFFNESS = 400.0
REST_S = 10.0


def solve(task):
    """One long step: the ball's velocity over the time, and the scale's sag."""
    readings = yield [
        call("step", duration=REST_S),
        call("get_velocity", object_id="object_2"),
        call("get_displacement", object_id="object_1"),
    ]
    pull = -readings[1]["velocity"][2] / REST_S
    weight = STIFFNESS * readings[2]["displacement"]
    yield [answer([weight, weight / pull])]


def theory(knobs):
    """The weight m (g + a), and the mass that was drawn."""
    return [knobs["m"] * (9.81 + knobs["a"]), knobs["m"]]


def measure(engine, knobs):
    """The engine's rest, and the ball's acceleration."""
    start = engine.pose("object_1").position[2]
    engine.step(engine.whole_steps(2 * REST_S))
    weight = STIFFNESS * float(start - engine.pose("object_1").position[2])
    return [weight, weight / -float(engine.acceleration("object_2")[2])]
