"""Scene 42, another way: one light ball stays in the pan, and known forces on it are raised to both thresholds.

The pan begins to sink from the top when the push P on it exceeds m g + friction, and to rise from the bottom when P
falls below m g - friction. The mean of the two thresholds is m g.
"""

from math import pi

from scenes.protocol import Call, Protocol, answer, call

GRAVITY = 9.81
BALL, RADIUS = 0.3, 0.1
TOP = 1.0
GREATEST = 140.0
PARTS, ROUNDS = 12, 4
SETTLING, WATCHED = 1.5, 2.0
MOVED = 3e-4


def push(force: float) -> Call:
    """Let the ball press on the pan with this force, which includes its weight."""
    return call("apply_force", object_id="ball", force_vector=[0, 0, BALL * GRAVITY - force])


def trial(start: float, force: float) -> list[Call]:
    """Move the pan to an end stop with the start force, then apply the other force and read whether it moves."""
    return [
        push(start),
        call("step", duration=SETTLING),
        call("get_position", object_id="object_2"),
        push(force),
        call("step", duration=WATCHED),
        call("get_position", object_id="object_2"),
    ]


def solve(task: str) -> Protocol:
    """Bracket both thresholds."""
    density = BALL / (4 / 3 * pi * RADIUS**3)
    yield [
        call("create_objects", name="ball", pos=[0, 0, TOP + RADIUS], density=density, rgba=[1, 0, 0, 1], radius=RADIUS)
    ]
    starts = (BALL * GRAVITY / 2, GREATEST)
    brackets = [(0.0, GREATEST), (0.0, GREATEST)]
    for _ in range(ROUNDS):
        forces = [[low + (high - low) * i / PARTS for i in range(1, PARTS)] for low, high in brackets]
        readings = yield [c for start, row in zip(starts, forces, strict=True) for f in row for c in trial(start, f)]
        heights = [r["position"][2] for r in readings if "orientation" in r]
        moved = [abs(after - before) > MOVED for before, after in zip(heights[::2], heights[1::2], strict=True)]
        for k, (low, high) in enumerate(brackets):
            seen = moved[k * (PARTS - 1) : (k + 1) * (PARTS - 1)]
            sinks = seen if k == 0 else [not m for m in seen]  # from the bottom, a sufficient push is one that holds it
            lighter = [f for f, s in zip(forces[k], sinks, strict=True) if not s]
            heavier = [f for f, s in zip(forces[k], sinks, strict=True) if s]
            brackets[k] = max([low, *lighter]), min([high, *heavier])
    yield [answer(sum(low + high for low, high in brackets) / 4 / GRAVITY)]
