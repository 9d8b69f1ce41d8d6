"""Null method: move the rider until the beam rests horizontally; the spring's law is not needed."""

import math

from scenes.protocol import Call, Protocol, answer, call

AXIS = 1.0
"""Height of the axis [m]."""
HALF = 1.2
"""Distance from the axis to the tip [m]."""
REST = 60.0
"""Half of the time for the beam to come to rest [s]."""
LEVEL = 1e-5
"""Height of the tip over the axis [m] that counts as level."""
FIRST = 0.3
"""Distance from the axis at the second trial [m]; at the first, the rider is on the axis."""
FARTHEST = 1.15
TRIALS = 8


def trial(distance: float, tip: list[float]) -> list[Call]:
    """Put the rider on the beam, whose tip is now at `tip`, wait, and read the positions of tip and rider."""
    x, z = (distance / HALF * part for part in (tip[0], tip[2] - AXIS))
    return [
        call("move_object", object_id="object_2", x=x, y=0, z=AXIS + z),
        call("step", duration=REST),
        call("step", duration=REST),
        call("get_position", object_id="object_1"),
        call("get_position", object_id="object_2"),
    ]


def solve(task: str) -> Protocol:
    """Secant method on the height of the tip above the axis, against the rider's position."""
    place, height = math.nan, math.nan
    target, tip = 0.0, [HALF, 0.0, AXIS]
    for _ in range(TRIALS):
        *_, beam, rider = yield trial(target, tip)
        tip, seat = beam["position"], rider["position"]
        last, before = place, height
        place, height = math.hypot(seat[0], seat[2] - AXIS), tip[2] - AXIS
        if abs(height) < LEVEL:
            break
        step = FIRST if math.isnan(last) else -height * (place - last) / (height - before)
        target = min(FARTHEST, max(0.0, place + step))
    yield [answer(place)]
