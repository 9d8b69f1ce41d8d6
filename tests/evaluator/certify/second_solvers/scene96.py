"""Scene 96, another way: statics only. Find the pull and the push on the hidden weight that just move the crate.

A pull P moves it up the slope if P + w > W s (1 + mu); a push Q lets it slide down if w - Q < W s (1 - mu). Here w is
the hidden weight, W the weight of the crate, and s = sin 45° = cos 45°. So the crate's weight is w / s + (P - Q) / 2 s,
and mu = (P + Q) / (2 W s).
"""

from math import sqrt

from scenes.protocol import Call, Protocol, answer, call

GRAVITY = 9.81
SLOPE = sqrt(0.5)
HIDDEN = "object_3"
STRONGEST = 35.0
DURATIONS = (0.1, 0.3, 1.0, 1.0, 1.0)  # s, duration of the trials in each round
PARTS = 7
REST = 5.0
CREEP = 5e-4  # m/s, more than a held crate creeps


def trial(force: float, duration: float) -> list[Call]:
    """Bring the crate to rest, read it, apply the vertical force to the hidden weight for a while, read it again."""
    return [
        call("apply_force", object_id=HIDDEN, force_vector=[0, 0, 0]),
        call("step", duration=REST),
        call("get_position", object_id="object_1"),
        call("apply_force", object_id=HIDDEN, force_vector=[0, 0, force]),
        call("step", duration=duration),
        call("get_position", object_id="object_1"),
    ]


def solve(task: str) -> Protocol:
    """Bracket the smallest pull and the smallest push that move the crate."""
    readings = yield [call("find_objects")]
    weight = readings[0]["revealed"][0]["mass"] * GRAVITY
    signs = (-1.0, 1.0)
    brackets = [(0.0, STRONGEST), (0.0, STRONGEST)]
    for duration in DURATIONS:
        sizes = [[low + (high - low) * i / PARTS for i in range(1, PARTS)] for low, high in brackets]
        pairs = list(zip(*sizes, strict=True))
        readings = yield [
            c for pair in pairs for sign, size in zip(signs, pair, strict=True) for c in trial(sign * size, duration)
        ]
        places = [r["position"][0] for r in readings if "position" in r]
        ways = [abs(after - before) for before, after in zip(places[::2], places[1::2], strict=True)]
        for k, (low, high) in enumerate(brackets):
            moved = [way > CREEP * duration for way in ways[k::2]]
            held = [size for size, m in zip(sizes[k], moved, strict=True) if not m]
            gone = [size for size, m in zip(sizes[k], moved, strict=True) if m]
            brackets[k] = max([low, *held]), min([high, *gone])
    pull, push = [(low + high) / 2 for low, high in brackets]
    crate = (2 * weight + pull - push) / (2 * SLOPE)
    yield [answer([crate / GRAVITY, (pull + push) / (2 * crate * SLOPE)])]
