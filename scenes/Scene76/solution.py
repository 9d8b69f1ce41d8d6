"""Scene 76: bracket each ball's peak, and compare it with its drop."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
BALLS = ("object_1", "object_2", "object_3")
LOOK_S = 0.05


def _look():
    return [call("get_position", object_id=ball) for ball in BALLS]


def _heights(readings):
    return [one["position"][2] - RADIUS for one in readings[-3:]]


def solve(task):
    """Step past each landing in turn, then with steps foretold by two looks to the ball's peak."""
    start = yield _look()
    drops, clock = _heights(start), 0.0
    peaks = {}
    for index in sorted(range(3), key=lambda i: drops[i]):
        landed = sqrt(2 * drops[index] / GRAVITY) + 0.08
        wait = max(landed - clock, LOOK_S)
        readings = yield [call("step", duration=wait), *_look(), call("step", duration=LOOK_S), *_look()]
        low, high = readings[1 + index]["position"][2], readings[-3 + index]["position"][2]
        clock = readings[4]["sim_time"]
        rise = max(((high - low) / LOOK_S - GRAVITY * LOOK_S / 2) / GRAVITY, LOOK_S)
        # The foretold peak is not taken on trust: the ball is looked at there.
        readings = yield [call("step", duration=rise), *_look()]
        clock = readings[0]["sim_time"]
        peaks[index] = max(high - RADIUS, _heights(readings)[index])
    shares = [peaks[index] / drops[index] for index in range(3)]
    yield [answer(BALLS[shares.index(max(shares))])]


def theory(knobs):
    """The ball with the least contact damping."""
    return BALLS[list(knobs["b"]).index(min(knobs["b"]))]


def measure(engine, knobs):
    """The ball with the largest energy after over energy before, in the engine's own speeds."""
    shares = []
    start = engine.save()
    for ball in BALLS:
        engine.restore(start)
        drop = engine.pose(ball).position[2] - RADIUS
        engine.step(engine.whole_steps(sqrt(2 * drop / GRAVITY) + 0.08))
        speed = float(np.linalg.norm(engine.twist(ball).linear))
        height = engine.pose(ball).position[2] - RADIUS
        shares.append((speed**2 / 2 + GRAVITY * height) / (GRAVITY * drop))
    return BALLS[shares.index(max(shares))]
