"""Scene 44, another way: a single fall; a known force on the ball is adjusted until the pan sinks at 2 m/s.

At constant speed the resistance equals the ball's weight plus the push on it, so a ball with this total weight sinks at
the same speed without a push.
"""

from math import log, pi

from scenes.protocol import Protocol, answer, call

GRAVITY, WANTED = 9.81, 2.0
BALL, RADIUS = 1.0, 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
FIRST, SECOND = 5.0, 10.0  # N
WAIT, STEADY = 10.0, 1e-4
LOADS = 14


def solve(task: str) -> Protocol:
    """Change the load by the secant rule, in logarithms, each time the speed has settled."""
    yield [
        call("create_objects", name="ball", pos=[0, 0, RADIUS], density=BALL / VOLUME, rgba=[1, 0, 0, 1], radius=RADIUS)
    ]
    look = [call("step", duration=WAIT), call("get_velocity", object_id="object_1")] * 4
    loads, speeds = [FIRST, SECOND], list[float]()
    for _ in range(LOADS):
        force = [0, 0, BALL * GRAVITY - loads[len(speeds)]]
        readings = yield [call("apply_force", object_id="ball", force_vector=force), *look]
        before, speed = (-r["velocity"][2] for r in (readings[-3], readings[-1]))
        if abs(speed - before) > STEADY * speed:
            continue
        speeds.append(speed)
        if abs(speed / WANTED - 1) < STEADY:
            break
        if len(speeds) > 1:
            exponent = log(loads[-1] / loads[-2]) / log(speeds[-1] / speeds[-2])
            loads.append(loads[-1] * (WANTED / speeds[-1]) ** exponent)
    yield [answer(loads[len(speeds) - 1] / GRAVITY / VOLUME)]
