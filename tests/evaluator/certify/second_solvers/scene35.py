"""Scene 35, another way: nothing is thrown at the wall; wall, gravity and air are measured, and the speed is computed.

The ball cannot be put where it would overlap the wall by more than 1 mm, so trying positions along two lines gives the
near face and the top. One free flight gives gravity and air resistance, which determine the path. The answer is the
smallest speed whose path stays the ball's radius away from the wall.
"""

from math import exp, hypot, log, sqrt

from scenes.protocol import Call, Protocol, answer, call

BALL = "object_1"
RADIUS, THICKNESS, TOLERANCE = 0.10, 0.10, 0.001
START = 1.0
NEAREST, FARTHEST = 2.7, 5.3
LOW, HIGH = -3.0, 9.0
PARTS, ROUNDS = 60, 3
ALOFT, THROW, FLIGHT = 50.0, 4.0, 1.0


def put(x: float, z: float) -> Call:
    """Try to put the ball there."""
    return call("move_object", object_id=BALL, x=x, y=0, z=z)


def clears(speed: float, gravity: float, drag: float, face: float, top: float) -> bool:
    """Whether the ball misses the wall when it starts from the post at 45°."""
    start = speed * sqrt(0.5)
    reach = start / drag
    if reach <= face + THICKNESS:
        return False
    for i in range(4001):
        x = min(face - RADIUS + (THICKNESS + 2 * RADIUS) * i / 4000, reach * (1 - 1e-9))
        time = -log(1 - x / reach) / drag
        z = START + (start + gravity / drag) / drag * (1 - exp(-drag * time)) - gravity / drag * time
        beside = max(face - x, 0.0, x - face - THICKNESS)
        if z < top or hypot(beside, z - top) < RADIUS:
            return False
    return True


def solve(task: str) -> Protocol:
    """Measure a free flight, find the wall, and compute the speed."""
    readings = yield [
        put(0, ALOFT),
        call("set_velocity", object_id=BALL, velocity_vector=[-THROW, 0, 0]),
        call("step", duration=FLIGHT),
        call("get_velocity", object_id=BALL),
    ]
    vx, _, vz = readings[-1]["velocity"]
    drag = log(-THROW / vx) / FLIGHT
    gravity = -vz * drag / (1 - exp(-drag * FLIGHT))

    low, high = NEAREST, FARTHEST
    for _ in range(ROUNDS):
        places = [low + (high - low) * i / PARTS for i in range(PARTS + 1)]
        readings = yield [put(x, LOW) for x in places]
        first = next(i for i, r in enumerate(readings) if "error" in r)
        low, high = places[first - 1], places[first]
    face = high + RADIUS - TOLERANCE

    middle = face + THICKNESS / 2
    low, high = LOW, HIGH
    for _ in range(ROUNDS):
        places = [low + (high - low) * i / PARTS for i in range(PARTS + 1)]
        readings = yield [put(middle, z) for z in places]
        last = max(i for i, r in enumerate(readings) if "error" in r)
        low, high = places[last], places[last + 1]
    top = low - RADIUS + TOLERANCE

    slow, fast = 1.0, 60.0
    for _ in range(40):
        speed = (slow + fast) / 2
        slow, fast = (slow, speed) if clears(speed, gravity, drag, face, top) else (speed, fast)
    yield [answer(fast)]
