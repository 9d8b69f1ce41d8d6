"""Scene 98: push the carriage and its partner with and against each other; weigh every joint; swap who is driven."""

import numpy as np

from scenes.courses import Predictor
from scenes.family import members
from scenes.pairs import JOINTS, Pair, kept_speed, left_over
from scenes.protocol import answer, call

FAST, STRONGEST_N = 10.0, 8000.0
PAIR = Pair(
    joints=("warm", "sated", "fading"),
    open_body=0,
    held=1,
    pushed=2,
    sigma=(0.022, 0.055),
    net=4.0,
    bend=(0.3, 0.8),
    growth=10.0,
)
FIRST_N, BRISK = 0.04, 10.0
LEVELS = [(1, 0), (0.2, -0.4), (0.6, 1), (0, 1), (1, -1), (0.6, 1), (0, -1), (1, 1), (0.4, 1), (1, -0.6)]
SPANS_S = (1.2, 1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2)


def predict(structure, knobs):
    """Speed of object_1 and force on its partner."""
    return PAIR.steady(structure, knobs, FAST)


MODEL = Predictor(PAIR.laws, PAIR.course, predict)
fit = MODEL.fit


def solve(task):
    """Reveal the partner, find out how hard to push, drive both; compare all structures."""
    yield [call("find_objects")]
    seen = yield from PAIR.driven(FIRST_N, STRONGEST_N, BRISK, LEVELS, SPANS_S)
    yield [answer(MODEL.best(seen))]


PULSES = ((1.0, 0.3), (-1.0, -0.6), (1.0, 1.0), (-0.6, -1.0))
LADDER_N = np.geomspace(0.6, STRONGEST_N, 8)


def batch(task):
    """Ever stronger pushes on both, to and fro, and the same fit up to where a net caught."""
    plan = [call("find_objects")]
    for number, top in enumerate(LADDER_N):
        plan += PAIR.rig.leg(top * np.array(PULSES[number % 4]), 0.4)
    found = yield plan
    yield [answer(MODEL.best(list(zip(plan, found, strict=True))[1:]))]


def stage(task):
    """Push the partner as hard as one can until a net is near; read the speed of the carriage."""
    readings = yield [call("find_objects"), *PAIR.rig.leg((0.0, STRONGEST_N), 0.6)]
    yield [answer([abs(readings[-2]["velocity"][0]), STRONGEST_N])]


def rivals(readings):
    """Every joint with every resistance of the carriage."""
    course = PAIR.course(readings)
    return members(PAIR.laws(course), course, predict)


def structure(knobs):
    """How the joint is excited, and what resists the carriage."""
    return f"{knobs['kind']}, {knobs['law']}"


def naive(knobs):
    """No slip; and what is passed on while the partner goes at 1 m/s, carried on in proportion to the slip alone."""
    kind, law = structure(knobs).split(", ")
    firm, even = {**knobs, "p": 1e6}, {**knobs, "p": JOINTS[kind](knobs, 1.0, 1.0)}
    return {
        "no slip": PAIR.steady(f"oil, {law}", firm, FAST),
        "all linear": PAIR.steady("oil, linear", even, FAST),
    }


def measure(engine, knobs):
    """The engine's own speed and force, with a partner so heavy that it keeps its speed."""
    return kept_speed(engine, 1, [0.8 * predict(structure(knobs), knobs)[0], FAST], 30.0)


def settles(engine, knobs, off):
    """How far off both speeds are a while after a disturbance."""
    own, push = predict(structure(knobs), knobs)
    return left_over(engine, 1, [own, FAST], push, off, 15.0)
