"""Scene 37, another way: the beam is never balanced; it swings from stop to stop and its equation of motion is fitted.

With the load m at distance l to the left and the rider M at r to the right, a tilt t to the left obeys
(J + m l² + M r²) t'' + c t' = g cos t (m l - M r - b), where J is the beam's moment of inertia, b its first moment of
mass and c the damping of the oil. This is linear in m, J, c and b, so swings with several positions of load and rider
give all four by least squares.
"""

from math import asin, cos, hypot, radians

from scenes.protocol import Call, Protocol, Reading, answer, call

GRAVITY, TIME_STEP = 9.81, 0.005
RIDER = 2.0
AXIS = 1.0
SWINGS = ((0.6, -0.38), (0.6, 2.3), (0.6, -0.38), (0.16, 2.3), (0.16, -0.38), (0.35, 1.5), (0.35, -0.2), (0.16, 1.0))
STEPS, REST = 100, 2.5
FREE = radians(3.6)  # the stops act at larger tilts

Moment = tuple[float, float]


def swing(load: float, rider: float) -> list[Call]:
    """Place load and rider and read their positions step by step, then wait until the beam rests."""
    looks = [call("get_position", object_id=body) for body in ("object_2", "object_3")]
    return [
        call("move_object", object_id="object_2", x=-load, y=0, z=AXIS),
        call("move_object", object_id="object_3", x=rider, y=0, z=AXIS),
        *[*looks, call("step", duration=TIME_STEP)] * STEPS,
        call("step", duration=REST),
    ]


def distance(reading: Reading) -> float:
    """Distance of a piece to the right of the knife edge, along the beam."""
    x, _, z = reading["position"]
    return hypot(x, z - AXIS) * (1 if x > 0 else -1)


def equations(readings: list[Reading]) -> list[tuple[list[float], float]]:
    """Coefficients of m, J, c and b, and the right-hand side, for every time of free motion."""
    loads, riders = readings[2:-1:3], readings[3:-1:3]
    tilts = [asin((AXIS - r["position"][2]) / -distance(r)) for r in loads]
    found: list[tuple[list[float], float]] = []
    for i in range(2, len(tilts) - 1):
        before, now, after = tilts[i - 1 : i + 2]
        if max(abs(before), abs(now), abs(after)) < FREE:
            rate, change = (after - before) / (2 * TIME_STEP), (after - 2 * now + before) / TIME_STEP**2
            load, rider, pull = -distance(loads[i]), distance(riders[i]), GRAVITY * cos(now)
            row = [load**2 * change - pull * load, change, rate, pull]
            found.append((row, -RIDER * (rider**2 * change + pull * rider)))
    return found


def least_squares(found: list[tuple[list[float], float]]) -> list[float]:
    """The least-squares solution, from the normal equations by elimination."""
    size = len(found[0][0])
    rows = [[sum(r[i] * r[j] for r, _ in found) for j in range(size)] for i in range(size)]
    rows = [[*row, sum(r[i] * value for r, value in found)] for i, row in enumerate(rows)]
    for i in range(size):
        for j in range(size):
            if j != i:
                factor = rows[j][i] / rows[i][i]
                rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    return [rows[i][size] / rows[i][i] for i in range(size)]


def solve(task: str) -> Protocol:
    """Swing with load and rider at several positions, and fit."""
    found: list[tuple[list[float], float]] = []
    for load, rider in SWINGS:
        readings = yield swing(load, rider)
        found += equations(readings)
    yield [answer(least_squares(found)[0])]
