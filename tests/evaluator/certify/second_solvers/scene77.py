"""Scene 77, another way: the limit is not searched; one outward slide is recorded and its acceleration extrapolated.

While the puck slides outward with a taut thread, it obeys r'' = w² r - k (r - L) - F along the groove, which is linear
in r. The limit is where this is zero, because the largest friction at rest is also F.
"""

import itertools
from math import hypot

from scenes.protocol import Protocol, answer, call

PUCK, HEIGHT = "object_2", 0.55
STARTS = (2.2, 2.6, 3.0, 3.3, 3.6, 3.8, 3.9)
END = 3.97  # m, just before the end of the groove
PAUSE, LOOKS = 0.02, 150
SLID = 0.01


def solve(task: str) -> Protocol:
    """Put the puck farther out until it slides, and fit its motion."""
    record = [call("step", duration=PAUSE), call("get_position", object_id=PUCK)] * LOOKS
    east, north = 1.0, 0.0  # direction of the groove, read from the puck's last position
    places: list[float] = []
    for start in STARTS:
        readings = yield [
            call("move_object", object_id=PUCK, x=start * east, y=start * north, z=HEIGHT),
            *record,
        ]
        places = [hypot(*r["position"][:2]) for r in readings[2::2]]
        places = [p for p in places if p < END]
        if places[-1] - places[0] > SLID:
            break
        x, y, _ = readings[-1]["position"]
        east, north = x / hypot(x, y), y / hypot(x, y)
    last = next((i for i, (a, b) in enumerate(itertools.pairwise(places)) if b <= a), len(places))
    free = places[2:last]
    points = [
        (now, (after - 2 * now + before) / PAUSE**2)
        for before, now, after in zip(free, free[1:], free[2:], strict=False)
    ]
    mean_r, mean_a = sum(r for r, _ in points) / len(points), sum(a for _, a in points) / len(points)
    slope = sum((r - mean_r) * (a - mean_a) for r, a in points) / sum((r - mean_r) ** 2 for r, _ in points)
    yield [answer(mean_r - mean_a / slope)]
