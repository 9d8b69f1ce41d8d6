"""Scene 49: halve the range of distances by whether the puck gives way."""

import numpy as np

from scenes.protocol import answer, call

HEIGHT = 1.0
NEAR, FAR = 0.4, 2.4
ROUNDS = 11
WATCH_S = 2.0
MOVED_M = 0.0005


def solve(task):
    """Each time the weight is put at a distance from where the puck is now."""
    (found,) = yield [call("find_objects")]
    weight = found["revealed"][0]["object_id"]
    low, high, place = NEAR, FAR, 0.0
    for _ in range(ROUNDS):
        distance = (low + high) / 2
        readings = yield [
            call("move_object", object_id=weight, x=place + distance, y=0, z=HEIGHT),
            call("step", duration=WATCH_S),
            call("get_position", object_id="object_1"),
        ]
        moved = abs(readings[-1]["position"][0] - place) > MOVED_M
        low, high = (low, distance) if moved else (distance, high)
        place = readings[-1]["position"][0]
    yield [answer((low + high) / 2)]


def theory(knobs):
    """The free length and the stretch that balances the friction."""
    return knobs["length"] + knobs["friction"] / knobs["k"]


def measure(engine, knobs):
    """A finer search in the engine, each time from the same state."""
    start, wanted = engine.save(), theory(knobs)
    low, high = 0.9 * wanted, 1.1 * wanted
    for _ in range(9):
        distance = (low + high) / 2
        engine.restore(start)
        engine.place("object_2", np.array([distance, 0.0, HEIGHT]), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        moved = abs(engine.pose("object_1").position[0]) > MOVED_M
        low, high = (low, distance) if moved else (distance, high)
    return (low + high) / 2
