"""Scene 46, another way: the hidden object is balanced against the load with known forces at two fixed positions.

At position x the beam is about to tip when (W + F) x = K, where W is the object's weight, F a downward push on it and K
the moment of the loaded side. Two positions give W and K; the balance without a push is at K / W.
"""

from scenes.protocol import Call, Protocol, answer, call

AXIS_HEIGHT = 1.0
PLACES = (0.6, 1.15)
STRONGEST = 200.0  # N, upward or downward
PARTS = 12  # parts into which each round divides a bracket
ROUNDS = 7
TIPPED = 2e-4  # m, more than the compression of a stop


def trial(place: float, push: float) -> list[Call]:
    """Lift the beam back onto its stop, put the object at its position, push, wait and read the tip."""
    return [
        call("apply_force", object_id="object_2", force_vector=[0, 0, STRONGEST]),
        call("move_object", object_id="object_2", x=place, y=0, z=AXIS_HEIGHT),
        call("step", duration=1.5),
        call("move_object", object_id="object_2", x=place, y=0, z=AXIS_HEIGHT),
        call("apply_force", object_id="object_2", force_vector=[0, 0, -push]),
        call("step", duration=1.5),
        call("get_position", object_id="object_1"),
    ]


def solve(task: str) -> Protocol:
    """Bracket the critical push at both positions, then eliminate the weight."""
    yield [call("find_objects")]
    brackets = [(-STRONGEST, STRONGEST) for _ in PLACES]
    for _ in range(ROUNDS):
        pushes = [[low + (high - low) * i / PARTS for i in range(1, PARTS)] for low, high in brackets]
        readings = yield [c for x, row in zip(PLACES, pushes, strict=True) for push in row for c in trial(x, push)]
        heights = [r["position"][2] for r in readings if "position" in r and "note" not in r]
        for k, row in enumerate(pushes):
            seen = heights[k * len(row) : (k + 1) * len(row)]
            held = [push for push, z in zip(row, seen, strict=True) if z > AXIS_HEIGHT - TIPPED]
            fell = [push for push, z in zip(row, seen, strict=True) if z <= AXIS_HEIGHT - TIPPED]
            low, high = brackets[k]
            brackets[k] = max([low, *held]), min([high, *fell])
    (x1, x2), (push1, push2) = PLACES, [(low + high) / 2 for low, high in brackets]
    weight = (push2 * x2 - push1 * x1) / (x1 - x2)
    yield [answer((weight + push1) * x1 / weight)]
