"""Scene 88: launch faster or slower, by whether the ball went round with its distance from the end unchanged."""

from math import cos, hypot, pi, sin, sqrt

import numpy as np

from scenes.protocol import answer, call

CORD, END_Z = 1.0, 2.0
BOTTOM = {"x": 0, "y": 0, "z": END_Z - CORD}
SLOW, FAST = 2.0, 20.0
ROUNDS = 13
LOOKS_PER_TURN, LOOKS = 30, 60
SLACK_M = 0.001


def _taut_all_round(places):
    """Whether the ball, launched towards +x, came past the top to the side of -x with the cord never slack."""
    for x, _, z in places:
        if hypot(x, z - END_Z) < CORD - SLACK_M:
            return False
        if x < 0 and z < END_Z:
            return True
    return False


def _turned_back(places):
    """A slow ball swings back on the taut cord and passes the bottom to -x from there."""
    first = next((place for place in places if place[0] < 0), None)
    return first is None or first[2] < END_Z


def solve(task):
    """Every round launches the ball once and follows it."""
    low, high = SLOW, FAST
    for _ in range(ROUNDS):
        speed = sqrt(low * high)
        # A ball that just goes round takes about half as long again as one at a steady speed.
        pause = max(round(2 * pi * CORD / speed / LOOKS_PER_TURN / 0.005), 1) * 0.005
        looks = [call("step", duration=pause), call("get_position", object_id="object_1")] * LOOKS
        readings = yield [
            call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
            call("move_object", object_id="object_1", **BOTTOM),
            call("set_velocity", object_id="object_1", velocity_vector=[speed, 0, 0]),
            *looks,
        ]
        places = [reading["position"] for reading in readings[4::2]]
        round_it_goes = _taut_all_round(places) and not _turned_back(places)
        low, high = (low, speed) if round_it_goes else (speed, high)
    yield [answer(sqrt(low * high))]


def _least_pull(speed, gravity, drag):
    """Least pull of the cord per mass [m/s²] on the way round, or a negative number if the ball turns back."""
    angle, rate, tick, least = 0.0, speed / CORD, 0.004, gravity

    def turning(angle, rate):
        return -gravity / CORD * sin(angle) - drag * rate

    while angle < 2 * pi:
        middle = rate + tick / 2 * turning(angle, rate)
        rate += tick * turning(angle + tick / 2 * rate, middle)
        angle += tick * middle
        if rate <= 0:
            return -gravity
        least = min(least, CORD * rate**2 + gravity * cos(angle))
    return least


def theory(knobs):
    """The speed at which the least pull on the way round is zero, by halving."""
    low, high = SLOW, FAST
    for _ in range(12):
        speed = sqrt(low * high)
        low, high = (low, speed) if _least_pull(speed, knobs["g"], knobs["drag"]) > 0 else (speed, high)
    return sqrt(low * high)


def measure(engine, knobs):
    """The same search in the engine, looking at every step."""
    start = engine.save()
    low, high = SLOW, FAST
    for _ in range(12):
        speed = sqrt(low * high)
        engine.restore(start)
        engine.set_velocity("object_1", np.array([speed, 0.0, 0.0]))
        places = []
        while len(places) < 1500 and not (places and (places[-1][0] < 0 or _slack(places[-1]))):
            engine.step(1)
            places.append(engine.pose("object_1").position.copy())
        came_round = places[-1][0] < 0 and places[-1][2] > END_Z
        while came_round and places[-1][2] > END_Z and not _slack(places[-1]):
            engine.step(1)
            places.append(engine.pose("object_1").position.copy())
        low, high = (low, speed) if came_round and not _slack(places[-1]) else (speed, high)
    return sqrt(low * high)


def _slack(place):
    return hypot(place[0], place[2] - END_Z) < CORD - SLACK_M
