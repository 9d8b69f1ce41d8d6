"""Scene 98: push the carriage and its partner with and against each other; weigh every joint; swap who is driven."""

from scenes.courses import Predictor
from scenes.family import members
from scenes.pairs import JOINTS, Pair, kept_speed, left_over
from scenes.protocol import answer, call

FAST, STRONGEST_N = 10.0, 400.0
PAIR = Pair(joints=("oil", "turbo", "grease"), open_body=0, held=1, pushed=2, sigma=(0.015, 0.04), net=3.0)
FIRST_N, BRISK = 0.15, 8.0
LEVELS = [(1, 0), (0.2, -0.4), (1, 1), (0, 1), (1, -1), (1, 0.4), (0.3, -1), (0.2, 1), (1, -0.6)]
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


def batch(task):
    """Ever stronger pushes on one, the other or both, and the same fit up to where a net caught."""
    plan = [call("find_objects")]
    for first, second in ((1, 0), (-2, 3), (5, -10), (20, -6), (-30, 40), (90, -60), (-150, 200), (400, -300)):
        plan += PAIR.rig.leg((first, second), 0.45)
    found = yield plan
    yield [answer(MODEL.best(list(zip(plan, found, strict=True))[1:]))]


def stage(task):
    """Push the partner as hard as one can until a net is near; read the speed of the carriage."""
    readings = yield [call("find_objects"), *PAIR.rig.leg((0.0, STRONGEST_N), 0.6)]
    yield [answer([abs(readings[-2]["velocity"][0]), STRONGEST_N])]


def rivals(readings):
    """Every joint with every resistance of the carriage."""
    return members(PAIR.laws, PAIR.course(readings), predict)


def structure(knobs):
    """What joins the two, and what resists the carriage."""
    return f"{knobs['kind']}, {knobs['law']}"


def _alone(knobs):
    """The partner's own resistance, and the carriage at the speed of wheels that nothing slips from."""
    return [FAST / knobs["n"], knobs["m"] * knobs["r"] * FAST]


def naive(knobs):
    """No slip, and the partner alone; what passes at a slip of 1 m/s carried on in proportion."""
    even = {**knobs, "p": float(JOINTS[knobs["kind"]](knobs, 1.0))}
    return {"no slip": _alone(knobs), "all linear": PAIR.steady("oil, linear", even, FAST)}


def measure(engine, knobs):
    """The engine's own speed and force, with a partner so heavy that it keeps its speed."""
    return kept_speed(engine, 1, [FAST, 0.8 * predict(structure(knobs), knobs)[0]][::-1], 30.0)


def settles(engine, knobs, off):
    """How far off both speeds are a while after a disturbance."""
    own, push = predict(structure(knobs), knobs)
    return left_over(engine, 1, [own, FAST], push, off, 15.0)
