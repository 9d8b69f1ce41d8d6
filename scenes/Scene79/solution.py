"""Scene 79: let the distance swing wider and wider short of the hooks, fit push, pull and cord, balance energies."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing

SPEED, FORCE, NEAR_M, FAR_M, NET_M, TIME_S = 2.5, 4.0, 0.7, 1.4, 3.0, 12.0
_COMMON = ("m1", "m2", "a", "p")
STRUCTURES = {
    "steady": _COMMON,
    "spring": (*_COMMON, "b"),
    "steady cord": (*_COMMON, "c", "begins"),
    "spring cord": (*_COMMON, "b", "c", "begins"),
}
BOX = {
    "m1": (0.01, 15.0),
    "m2": (0.005, 40.0),
    "a": (0.5, 15.0),
    "p": (1.0, 5.5),
    "b": (0.4, 4.0),
    "c": (1.5, 25.0),
    "begins": (1.15, 1.3),
}
"""Push at 1 m over the reduced mass; its power; growth of the pull and stiffness of the cord, over the pull at 1 m."""
REACHES = (0.2, 0.4, 0.6, 0.75, 0.85, 0.91, 0.94)
"""How far the distance is let go in each round, over the way to the hooks; the last goes on."""


def _strength(knobs, d):
    """Force that drives the gliders apart, over the reduced mass."""
    d = np.maximum(d, 0.05)
    pull = 1 + knobs.get("b", 0.0) * (d - 1)
    if "c" in knobs:
        pull = pull + knobs["c"] * np.maximum(d - knobs["begins"], 0.0)
    return knobs["a"] * (d ** -knobs["p"] - pull)


def _rates(structure, knobs, time, state, control):
    """Time derivative of both places and both speeds."""
    x1, x2, v1, v2 = np.clip(state, -50.0, 50.0)
    apart = _strength(knobs, x2 - x1) / (1 / knobs["m1"] + 1 / knobs["m2"])
    return np.array([v1, v2, (control[0] - apart) / knobs["m1"], apart / knobs["m2"]])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(-0.5, 0.5, 0.0, 0.0),
    sigma=(0.0003, 0.0003, 0.00077, 0.00077),
    longest_s=0.05,
    starts=150,
    tried=3,
    rounds=10,
    plain=STRUCTURES["spring"],
)


RIG = Rig(
    [force("object_1", 0)],
    [of(body, 0) for of in (position, velocity) for body in ("object_1", "object_2")],
)


def _distance(course):
    """Distance of the gliders at the end of each leg."""
    return course.readings[:, 1] - course.readings[:, 0]


def _course(readings):
    """Forces, places and speeds, up to where a hook or a net caught."""
    course = RIG.course(readings)
    d, far = _distance(course), abs(course.readings[:, :2]).max(axis=1)
    return course.until((d < NEAR_M + 0.005) | (d > FAR_M - 0.005) | (far > NET_M))


def _wider(course):
    """Somewhat more than the share of the way to the hooks that the distance has swung."""
    d = _distance(course)
    return 0.1 + 2 * float(max((1 - d.min()) / (1 - NEAR_M), (d.max() - 1) / (FAR_M - 1)))


def _worth(plan, path):
    """The distance swings, but not beyond the reach, and the pair stays in the middle of the rail."""
    x1, x2, v1, v2 = path.transpose(1, 0, 2)
    least, most, d = 1 - plan.reach * (1 - NEAR_M), 1 + plan.reach * (FAR_M - 1), x2 - x1
    value = abs(d - 1) - 1e3 * (np.maximum(d - most, 0.0) + np.maximum(least - d, 0.0))
    value += 5 * np.maximum(np.minimum(d, most) - 1.25, 0.0) + 8 * np.maximum(0.85 - np.maximum(d, least), 0.0)
    share = plan.knobs["m1"] / (plan.knobs["m1"] + plan.knobs["m2"])
    ahead = share * (x1 + 2 * v1)[-1] + (1 - share) * (x2 + 2 * v2)[-1]
    return value.sum(axis=0) - 3 * np.maximum(abs(ahead) - 0.8, 0.0)


def _potential(knobs, d):
    """Potential energy over the reduced mass, from 1 m on."""
    p = knobs["p"]
    push = np.log(d) if abs(p - 1) < 1e-6 else (d ** (1 - p) - 1) / (1 - p)
    cord = knobs.get("c", 0.0) * max(d - knobs.get("begins", 1.0), 0.0) ** 2 / 2
    return knobs["a"] * (d - 1 + knobs.get("b", 0.0) * (d - 1) ** 2 / 2 + cord - push)


def predict(structure, knobs):
    """Smallest and largest distance."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}

    def left(d):
        return _potential(knobs, d) - SPEED**2 / 2

    least = brentq(left, 0.001, 1.0) if left(0.001) > 0 else 0.001
    return [float(least), float(brentq(left, 1.0, 1e4)) if left(1e4) > 0 else 1e4]


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.01, 0.06, 0.36, 2.0, 4.0),
    moved=lambda reading: abs(reading[2]) > 0.03,
    settled=lambda _: ((0.0, 0.3), (0.0, 0.3)),
    strongest=lambda plan: min(FORCE, 1.2 * plan.reach * plan.knobs["a"] * plan.knobs["m1"]),
    worth=_worth,
    span=lambda knobs: float(np.clip(0.9 / np.sqrt(knobs["a"] * (knobs["p"] + knobs["b"])), 0.1, 0.6)),
    reaches=REACHES,
    wider=_wider,
    legs=2,
    trials=200,
    time_s=TIME_S - 1.6,
    fixed_pushes=(0.05, 0.0, -0.2, 0.0, 0.8, -0.8, 2.0, -2.0, 4.0, -4.0),
    fixed_s=0.4,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Each pull, with and without a cord, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """Small oscillations carried on; object_2 does not recoil."""
    stiffness = knobs["a"] * (knobs["p"] + knobs["b"])
    swing = SPEED / np.sqrt(stiffness)
    heavy = predict(knobs["kind"], {**knobs, "a": knobs["a"] * knobs["mu"] / knobs["m1"]})
    return {"harmonic": [max(1 - swing, 0.0), 1 + swing], "without recoil": heavy}


def stage(task):
    """Push as hard as possible, one way and the other."""
    readings = yield [*RIG.leg(FORCE, 0.4, 2), *RIG.leg(-FORCE, 0.8, 2)]
    places = [reading["position"][0] for reading in readings if "position" in reading]
    d = [right - left for left, right in zip(places[::2], places[1::2], strict=True)]
    yield [answer([min(d), max(d)])]


def measure(engine, knobs):
    """Both blows in the engine, without hooks and nets."""
    ends = []
    for sign in (1, -1):
        free = engine.changed(
            {"body[hook].pos": (0.0, 0.0, 0.0), "key[start].qvel": (sign * SPEED, 0.0, 0.0, 0.0, 0.0)}
        )
        path = [1.0]
        while len(path) < 3 or sign * path[-1] < sign * path[-2]:
            free.step(1)
            path.append(float(free.pose("object_2").position[0] - free.pose("object_1").position[0]))
        ends.append(path[-2])
    return ends
