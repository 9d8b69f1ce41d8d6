"""Scene 87: shoot, see where the ball comes down, and correct the pull until it passes the point."""

from itertools import pairwise
from math import exp

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
MOUTH_Z = 3.0
RANGE = 3.0
LOOK_S = 0.03
LOOKS = 70
FIRST = 0.4
MOST = 2.8
FOLLOW_S = 2.5
ROUNDS = 10
NEAR = 0.01


def _shot(pull):
    """Let the ball go from rest, and look where it is at short intervals."""
    return [
        call("move_object", object_id="object_1", x=-pull, y=0, z=MOUTH_Z),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        *([call("step", duration=LOOK_S), call("get_position", object_id="object_1")] * LOOKS),
    ]


def _reach(places):
    """Where the ball passes z = 0; if it never leaves the barrel, where it stays."""
    for before, after in pairwise(places):
        if after[2] <= 0 < before[2]:
            return before[0] + (after[0] - before[0]) * before[2] / (before[2] - after[2])
    return places[-1][0]


def solve(task):
    """Keep a pull that is too short and one that is too long, and go in between by where the ball came down."""
    low, near, high, far = 0.0, 0.0, MOST, None
    pull = FIRST
    for turn in range(ROUNDS):
        readings = yield _shot(pull)
        reach = _reach([one["position"] for one in readings[3::2]])
        if abs(reach - RANGE) < NEAR:
            break
        if reach < RANGE:
            low, near = pull, reach
        else:
            high, far = pull, reach
        if far is None:
            pull = min(2 * pull, MOST)
        elif turn % 3 == 2:
            pull = (low + high) / 2
        else:
            pull = low + (RANGE - near) / (far - near) * (high - low)
    yield [answer(pull)]


def _mouth_speed(gamma):
    """Speed that carries the ball to the point: drop (g/γ)(t - s), way v s, with s = (1 - exp(-γt))/γ."""
    early, late = 0.0, 10.0
    for _ in range(60):
        time = (early + late) / 2
        spent = (1 - exp(-gamma * time)) / gamma
        early, late = (time, late) if GRAVITY / gamma * (time - spent) < MOUTH_Z else (early, time)
    return RANGE / spent


def theory(knobs):
    """Backwards in time from the speed needed at the mouth to rest in the barrel."""
    play, reach = knobs["play"], knobs["play"] + knobs["lag"]

    def push(place, speed):
        springs = knobs["first"] * max(-place - play, 0.0) + knobs["second"] * max(-place - reach, 0.0)
        return springs - knobs["mu"] * GRAVITY - knobs["gamma"] * speed

    place, speed, tick = 0.0, _mouth_speed(knobs["gamma"]), 0.001
    while True:
        middle = speed - tick / 2 * push(place, speed)
        earlier_place = place - tick * middle
        earlier = speed - tick * push(place - tick / 2 * speed, middle)
        if earlier <= 0:
            # At the turning point the way left is v² / (2 a), with the acceleration there.
            return -place + speed**2 / (2 * push(place, 0.0))
        place, speed = earlier_place, earlier


def measure(engine, knobs):
    """The same pull by halving in the engine, from its speed at the level of the point."""
    start = engine.save()
    low, high = 0.0, MOST + 0.1
    for _ in range(14):
        pull = (low + high) / 2
        engine.restore(start)
        engine.place("object_1", np.array([-pull, 0.0, MOUTH_Z]), {})
        place = engine.pose("object_1").position
        for _ in range(engine.whole_steps(FOLLOW_S)):
            engine.step(1)
            before, place = place, engine.pose("object_1").position
            if place[2] <= 0:
                break
        share = before[2] / (before[2] - place[2]) if place[2] <= 0 else 0.0
        low, high = (pull, high) if before[0] + share * (place[0] - before[0]) < RANGE else (low, pull)
    return (low + high) / 2
