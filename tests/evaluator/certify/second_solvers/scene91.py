"""Scene 91, another way: one run; the ball is deleted in motion, and the jump of the acceleration gives the inertia.

With the ball (M + I/R²) a = m g - f, without it (M - m + I/R²) a' = -f; at the same speed the bearing friction f is
equal. The disk's energy is ½ (I/R²) v² with the speed v of the pan after 1.00 m.
"""

import itertools
from math import pi

from scenes.protocol import Call, Protocol, Reading, answer, call

GRAVITY = 9.81
BALL, RADIUS = 2.0, 0.1
EMPTY = 0.1 + 0.1  # kg, pan and counterweight
WAY = 1.0
PAUSE, LOOKS = 0.01, 20


def watch() -> list[Call]:
    """Read the pan's motion at short intervals."""
    look = [
        call("step", duration=PAUSE),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_2"),
    ]
    return look * LOOKS


def track(readings: list[Reading]) -> list[tuple[float, float, float]]:
    """Time, height and downward speed at every reading."""
    looks = zip(readings[1::3], readings[2::3], strict=True)
    return [(p["sim_time"], p["position"][2], -v["velocity"][2]) for p, v in looks]


def acceleration(looks: list[tuple[float, float, float]], speed: float) -> float:
    """Acceleration at a speed, from a linear fit of acceleration against speed."""
    pairs = list(itertools.pairwise(looks))
    points = [((v0 + v1) / 2, (v1 - v0) / (t1 - t0)) for (t0, _, v0), (t1, _, v1) in pairs]
    mean_v, mean_a = sum(v for v, _ in points) / len(points), sum(a for _, a in points) / len(points)
    gain = sum((v - mean_v) * (a - mean_a) for v, a in points) / sum((v - mean_v) ** 2 for v, _ in points)
    return mean_a + gain * (speed - mean_v)


def solve(task: str) -> Protocol:
    """Let the ball sink past the mark, delete it, and compare the accelerations at that moment."""
    readings = yield [
        call("get_position", object_id="object_2"),
        call(
            "create_objects",
            name="ball",
            pos=[0, 0, 5 + RADIUS],
            density=BALL / (4 / 3 * pi * RADIUS**3),
            rgba=[1, 0, 0, 1],
            radius=RADIUS,
        ),
    ]
    mark = readings[0]["position"][2] - WAY
    loaded: list[tuple[float, float, float]] = []
    while not loaded or loaded[-1][1] > mark:
        loaded += track((yield watch()))
    readings = yield [call("delete_objects", object_id="ball"), *watch()]
    freed = track(readings[1:])
    last_speed = loaded[-1][2]
    a_loaded, a_freed = acceleration(loaded[-LOOKS:], last_speed), acceleration(freed, last_speed)
    disk = (BALL * GRAVITY - (BALL + EMPTY) * a_loaded + EMPTY * a_freed) / (a_loaded - a_freed)
    (_, z0, v0), (_, z1, v1) = next(pair for pair in itertools.pairwise(loaded) if pair[0][1] > mark >= pair[1][1])
    speed = v0 + (v1 - v0) * (z0 - mark) / (z0 - z1)
    yield [answer(disk * speed**2 / 2)]
