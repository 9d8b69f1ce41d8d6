"""Energy balance of the fall: only distance and speed of the weight are read, no acceleration."""

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
CART = 3.0
"""Mass of the cart [kg]."""
FRICTION = 0.20
RUN = 0.4
"""Time of the fall [s]."""


def solve(task: str) -> Protocol:
    """m g s = (M + m) v^2 / 2 + friction M g s, the work of gravity over the distance s."""
    yield [call("find_objects")]
    before, _, after, speed = yield [
        call("get_position", object_id="object_2"),
        call("step", duration=RUN),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_2"),
    ]
    lost = GRAVITY * (before["position"][2] - after["position"][2])
    gained = sum(part**2 for part in speed["velocity"]) / 2
    yield [answer(CART * (gained + FRICTION * lost) / (lost - gained))]
