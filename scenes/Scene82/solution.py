"""Scene 82: lead the puck in wider and wider loops below the rim, fit the pull, and conserve energy and momentum."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing

RIM_M, FORCE, LAUNCH_M, SPEED = 0.8, 20.0, 0.5, 8.0
STRUCTURES = {
    "second": ("m", "k", "begins", "k2"),
    "reel": ("m", "k", "begins"),
    "turning second": ("m", "k", "begins", "k2", "w"),
    "turning reel": ("m", "k", "begins", "w"),
}
BOX = {
    "m": (0.02, 20.0),
    "k": (3.0, 50.0),
    "begins": (0.4, 0.7),
    "k2": (3.0, 300.0),
    "w": (-3.0, 3.0),
    "bend": (-1.0, 4.0),
}
"""All but the mass over the mass."""
FAR_M = 0.5


def _pull(structure, knobs, r):
    """Pull of the cord over the mass."""
    if structure == "plain":
        return knobs["k"] * (r + knobs["bend"] * r**3)
    return knobs["k"] * r + (-knobs["k"] if "reel" in structure else knobs["k2"]) * np.maximum(r - knobs["begins"], 0.0)


def _rates(structure, knobs, time, state, control):
    """Time derivative of place and velocity."""
    x, y, vx, vy = np.clip(state, -50.0, 50.0)
    r, w = np.hypot(x, y) + 1e-9, knobs.get("w", 0.0)
    pull = _pull(structure, knobs, r) / r
    return np.array([vx, vy, control[0] / knobs["m"] - pull * x - w * vy, control[1] / knobs["m"] - pull * y + w * vx])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.0066, 0.0066, 0.0301, 0.0301),
    longest_s=0.08,
    starts=150,
    tried=3,
    rounds=8,
    plain=("m", "k", "bend", "w"),
)
"""The plain law has a pull that bends smoothly."""
RIG = Rig(
    [force("object_1", 0), force("object_1", 1)],
    [of("object_1", axis) for of in (position, velocity) for axis in (0, 1)],
)


def _distance(course):
    """Distance from the hole at the end of each leg."""
    return np.hypot(course.readings[:, 0], course.readings[:, 1])


def _course(readings):
    """The course up to where the rim caught."""
    course = RIG.course(readings)
    return course.until(_distance(course) > RIM_M - 0.005)


def _all_around(rng, legs, trials):
    """Forces of some sizes in all directions."""
    size = rng.choice([0.0, 0.2, 0.5, 1.0], (legs, trials))
    angle = rng.uniform(0, 2 * np.pi, (legs, trials))
    return np.array([size * np.cos(angle), size * np.sin(angle)]).transpose(1, 0, 2)


def _worth(plan, path):
    """Goes far out, within the reach."""
    r = np.hypot(path[:, 0], path[:, 1])
    wide = 3 * np.maximum(np.minimum(r, plan.reach) - FAR_M, 0.0) + 0.2 * r
    return (wide - 1e3 * np.maximum(r - plan.reach, 0.0)).sum(axis=0)


def predict(structure, knobs):
    """Largest distance and the speed there."""
    k, begins, w = knobs["k"], knobs["begins"], knobs.get("w", 0.0) if "turning" in structure else 0.0
    beyond = -k if "reel" in structure else knobs["k2"]

    def across(r):
        return (LAUNCH_M * SPEED + w * (r**2 - LAUNCH_M**2) / 2) / r

    def left(r):
        stored = [k * at**2 / 2 + beyond * max(0.0, at - begins) ** 2 / 2 for at in (LAUNCH_M, r)]
        return SPEED**2 / 2 - across(r) ** 2 / 2 - stored[1] + stored[0]

    grid = LAUNCH_M + np.geomspace(1e-4, 60, 1500)
    signs = np.array([left(r) for r in grid])
    ends = np.nonzero(signs < 0)[0]
    if not len(ends) or ends[0] == 0:
        return [float(grid[-1 if not len(ends) else 0]), SPEED]
    r = float(brentq(left, grid[ends[0] - 1], grid[ends[0]]))
    return [r, float(abs(across(r)))]


SIZES = (0.1, 0.0, 0.2, 0.0, 0.5, 0.0, 1.0, 0.0, 2.0, 0.0, 5.0, 0.0, 10.0, 0.0, 20.0)
SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.05, 0.5, 5.0),
    moved=lambda reading: reading[2] > 0.12,
    settled=lambda _: ((0.0, 0.15), (0.0, 0.15), (0.0, 0.15)),
    strongest=lambda plan: min(0.999 * FORCE, 0.9 * plan.reach * plan.knobs["m"] * plan.knobs["k"]),
    pattern=_all_around,
    worth=_worth,
    span=lambda knobs: float(np.clip(1.1 / np.sqrt(knobs["k"]), 0.1, 0.5)),
    reaches=(0.25, 0.4, 0.5, 0.58, 0.64, 0.68, 0.71, 0.74, 0.75),
    wider=lambda course: 0.05 + 2 * float(_distance(course).max()),
    rounds=15,
    legs=2,
    time_s=14.95,
    fixed_pushes=[(f, 0.3 * f * (-1) ** number) for number, f in enumerate(SIZES)],
    fixed_s=0.35,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Each pull, with and without a force across the motion, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """The cord near the hole carried on; the launch speed all spent on the cord, as if launched straight away."""
    k, kind = knobs["k"], knobs["kind"]
    alone = (
        predict("second", {**knobs, "k2": 0.0})
        if "turning" not in kind
        else predict("turning second", {**knobs, "k2": 0.0})
    )
    straight = float(np.sqrt(LAUNCH_M**2 + SPEED**2 / k))
    return {"first cord": alone, "straight": [straight, LAUNCH_M * SPEED / straight]}


def stage(task):
    """Push as hard as possible, and read the largest distance."""
    calls = RIG.leg(FORCE, 1.5, 5)
    readings = yield calls
    far = max(abs(reading["position"][0]) for reading in readings if "position" in reading)
    yield [answer([far, LAUNCH_M * SPEED / far])]


def measure(engine, knobs):
    """The same flight in the engine, without the rim."""
    free = engine.changed({"body[rim].pos": (0, 0, 0), "key[start].qpos": (LAUNCH_M, 0), "key[start].qvel": (0, SPEED)})
    path = []
    while len(path) < 3 or path[-1][0] >= path[-2][0]:
        free.step(1)
        x, y, _ = free.pose("object_1").position
        path.append((float(np.hypot(x, y)), float(np.hypot(*free.twist("object_1").linear[:2]))))
    return list(path[-2])
