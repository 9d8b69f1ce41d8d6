"""Scene 76, another way: nothing is dropped; the balls are thrown down from the level of the floor.

A fall from height h ends with v² = 2 g h, so throwing a ball down from the surface with v is equivalent. All three are
thrown at once; many speeds bracket the height of which half is returned.
"""

from math import sqrt

from scenes.protocol import Call, Protocol, Reading, answer, call

GRAVITY, TIME_STEP = 9.81, 0.005
RADIUS = 0.20
BALLS = ("object_1", "object_2", "object_3")
PLACES = (-1.0, 0.0, 1.0)
LOWEST, HIGHEST = 0.30, 4.50
LOOKS, PAUSE = 14, 0.05
PARTS, ROUNDS = 7, 4


def throw(heights: tuple[float, ...]) -> list[Call]:
    """Put each ball onto the floor with the speed of a fall from its height, and read their motion."""
    calls: list[Call] = []
    for ball, x, height in zip(BALLS, PLACES, heights, strict=True):
        calls.append(call("move_object", object_id=ball, x=x, y=0, z=RADIUS))
        calls.append(call("set_velocity", object_id=ball, velocity_vector=[0, 0, -sqrt(2 * GRAVITY * height)]))
    for _ in range(LOOKS):
        calls.append(call("step", duration=PAUSE))
        for ball in BALLS:
            calls += [call("get_position", object_id=ball), call("get_velocity", object_id=ball)]
    return calls


def returned(looks: list[Reading]) -> float:
    """Height of return, from the first reading of a ball above the floor and rising; 0 if there is none."""
    for place, motion in zip(looks[::2], looks[1::2], strict=True):
        z, v = place["position"][2] - RADIUS, motion["velocity"][2]
        if z > 0 and v > 0:
            return z + v * v / (2 * GRAVITY) - v * TIME_STEP / 2
    return 0.0


def solve(task: str) -> Protocol:
    """Bracket the three heights of which half is returned."""
    brackets = [(LOWEST, HIGHEST)] * len(BALLS)
    for _ in range(ROUNDS):
        rows = [[low * (high / low) ** (i / (PARTS - 1)) for i in range(PARTS)] for low, high in brackets]
        trials = [throw(heights) for heights in zip(*rows, strict=True)]
        readings = yield [c for trial in trials for c in trial]
        size = len(trials[0])
        for k, row in enumerate(rows):
            shares: list[float] = []
            for i, height in enumerate(row):
                seen = readings[i * size + 2 * len(BALLS) : (i + 1) * size]
                looks = [r for j in range(1 + 2 * k, len(seen), 1 + 2 * len(BALLS)) for r in seen[j : j + 2]]
                shares.append(returned(looks) / height)
            over = max((i for i, share in enumerate(shares) if share > 0.5), default=0)
            brackets[k] = row[over], row[min(over + 1, PARTS - 1)]
    middles = [low + high for low, high in brackets]
    yield [answer(BALLS[middles.index(max(middles))])]
