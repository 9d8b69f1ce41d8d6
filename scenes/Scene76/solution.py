"""Scene 76: drive the first cart back and forth, fit all couplings and resistances, and extrapolate to 10 m/s."""

from scenes.courses import Predictor
from scenes.family import members
from scenes.pairs import JOINTS, Pair, kept_speed, left_over
from scenes.protocol import answer

SPEED_M_S = 10.0
PAIR = Pair(
    joints=("oil", "grease", "paste"), open_body=1, held=0, pushed=1, sigma=(0.009, 0.018), net=4.0, bend=(0.3, 0.8)
)
LEVELS = [(share, 0.0) for share in (1, 0.25, 0.25, 0.5, 0.25, 1, 0.25, 0.25, 0.5, 0.25)]
"""Weak pushes last longer between the nets: grease then brings object_2 to the speeds that tell its resistance."""
TIMES_S = (1.2, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2)


def predict(structure, knobs):
    """Speed of object_2 and force on object_1."""
    return PAIR.steady(structure, knobs, SPEED_M_S)


MODEL = Predictor(PAIR.laws, PAIR.course, predict)
fit = MODEL.fit


def rivals(readings):
    """Every coupling with every resistance."""
    course = PAIR.course(readings)
    return members(PAIR.laws(course), course, predict)


def solve(task):
    """Find a suitable force, drive the carts back and forth, and fit all combinations of couplings and resistances."""
    seen = yield from PAIR.driven(0.1, 3000.0, 9.0, LEVELS, TIMES_S)
    yield [answer(MODEL.best(seen))]


PULSES = tuple((0.3 * (-2.75) ** number, 0.45) for number in range(10))


def batch(task):
    """Ever stronger pushes to and fro, and the same fit up to where a net caught."""
    calls = [asked for push, duration in PULSES for asked in PAIR.rig.leg(push, duration)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Push as hard as one can until a net is near; read the speed of object_2."""
    readings = yield PAIR.rig.leg(3000.0, 0.6)
    yield [answer([abs(readings[-1]["velocity"][0]), 3000.0])]


def structure(knobs):
    """What couples the carts, and what resists object_2."""
    return f"{knobs['kind']}, {knobs['law']}"


def naive(knobs):
    """No slip; and what is passed on at a slip of 1 m/s carried on in proportion."""
    kind, law = structure(knobs).split(", ")
    firm, even = {**knobs, "p": 1e6}, {**knobs, "p": JOINTS[kind](knobs, 1.0, 1.0)}
    return {
        "no slip": PAIR.steady(f"oil, {law}", firm, SPEED_M_S),
        "all linear": PAIR.steady("oil, linear", even, SPEED_M_S),
    }


def measure(engine, knobs):
    """The engine's own speed and force, with object_1 so heavy that it keeps its speed."""
    return kept_speed(engine, 0, [SPEED_M_S, 0.8 * predict(structure(knobs), knobs)[0]], 30.0)


def settles(engine, knobs, off):
    """How far off both speeds are a while after a disturbance."""
    other, push = predict(structure(knobs), knobs)
    return left_over(engine, 0, [SPEED_M_S, other], push, off, 15.0)
