"""Scene 99, another way: neither force nor mass is used; the blocks start slowly and come to rest.

With friction alone v² / 2d = mu g for the braking distance d. For small v the drag adds a term proportional to v, which
an extrapolation from two small speeds removes.
"""

from scenes.protocol import Call, Protocol, answer, call

BLOCKS = ("object_2", "object_3", "object_4")
SPEEDS = (0.2, 0.4)
REST = 1.5


def look() -> list[Call]:
    """Read the positions of the blocks."""
    return [call("get_position", object_id=block) for block in BLOCKS]


def solve(task: str) -> Protocol:
    """Start all three at each speed and extrapolate v² / 2d to zero speed."""
    yield [call("find_objects")]
    brakings: list[list[float]] = []
    for speed in SPEEDS:
        throws = [call("set_velocity", object_id=block, velocity_vector=[speed, 0, 0]) for block in BLOCKS]
        readings = yield [*look(), *throws, call("step", duration=REST), *look()]
        ways = [readings[i - len(BLOCKS)]["position"][0] - readings[i]["position"][0] for i in range(len(BLOCKS))]
        brakings.append([speed**2 / (2 * way) for way in ways])
    slow, fast = brakings
    v0, v1 = SPEEDS
    frictions = [b0 - (b1 - b0) / (v1 - v0) * v0 for b0, b1 in zip(slow, fast, strict=True)]
    yield [answer(BLOCKS[frictions.index(min(frictions))])]
