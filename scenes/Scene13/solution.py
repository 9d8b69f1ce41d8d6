"""Scene 13: let the springs push; the heaviest cart is the slowest."""

from scenes.protocol import answer, call

CARTS = ("object_1", "object_2", "object_3")
RUN_S = 1.0


def solve(task):
    """One second, three momenta per kilogram."""
    readings = yield [
        call("step", duration=RUN_S),
        *(call("get_momentum", object_id=cart, mass=1.0) for cart in CARTS),
    ]
    speeds = dict(zip(CARTS, (reading["momentum"]["x"] for reading in readings[1:]), strict=True))
    yield [answer(min(CARTS, key=speeds.__getitem__))]


def theory(knobs):
    """The cart of the highest rank."""
    return CARTS[list(knobs["order"]).index(2)]


def measure(engine, knobs):
    """The cart that has the least acceleration at the start."""
    engine.step(1)
    return min(CARTS, key=lambda cart: engine.acceleration(cart)[0])
