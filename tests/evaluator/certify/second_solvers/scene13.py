"""The springs are not used: a known push on each free cart gives its mass from the change of speed."""

from scenes.protocol import Protocol, answer, call

CARTS = ("object_1", "object_2", "object_3")
FREE_AFTER = 5.0
"""Time after which every spring has released its cart [s]."""
PUSH = 3.0
"""[N]."""
PUSH_TIME = 1.0
"""[s]."""


def solve(task: str) -> Protocol:
    """Newton's second law on each cart: mass = force * time / change of speed."""
    speeds = [call("get_velocity", object_id=cart) for cart in CARTS]
    pushes = [call("apply_force", object_id=cart, force_vector=[PUSH, 0, 0]) for cart in CARTS]
    before = yield [call("step", duration=FREE_AFTER), *speeds, *pushes]
    after = yield [call("step", duration=PUSH_TIME), *speeds]
    masses: dict[str, float] = {}
    for number, cart in enumerate(CARTS, start=1):
        gain = after[number]["velocity"][0] - before[number]["velocity"][0]
        masses[cart] = PUSH * PUSH_TIME / gain
    yield [answer(max(masses, key=lambda cart: masses[cart]))]
