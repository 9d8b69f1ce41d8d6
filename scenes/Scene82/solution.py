"""Scene 82: lead the puck in wider and wider loops below the rim, fit the pull, and conserve energy and momentum."""

import numpy as np
from scipy.optimize import brentq

from scenes.courses import Course, Laws, force, position, recorded, refined, velocity
from scenes.protocol import answer, call

RIM_M, FORCE, LAUNCH_M, SPEED = 0.8, 20.0, 0.5, 8.0
STRUCTURES = {
    "second": ("m", "k", "begins", "k2"),
    "reel": ("m", "k", "begins"),
    "turning second": ("m", "k", "begins", "k2", "w"),
    "turning reel": ("m", "k", "begins", "w"),
}
PLAIN = ("m", "k", "bend", "w")
"""Constants of a pull that bends smoothly, with which the next forces are planned."""
BOX = {
    "m": (0.02, 20.0),
    "k": (3.0, 50.0),
    "begins": (0.35, 0.75),
    "k2": (3.0, 300.0),
    "w": (-3.0, 3.0),
    "bend": (-1.0, 4.0),
}
"""All but the mass over the mass."""
REACHES = (0.2, 0.3, 0.4, 0.5, 0.58, 0.64, 0.68, 0.71, 0.74, 0.75)
"""How far out the puck is let go in each iteration that has a model, in m; the last one goes on."""
FAR_M, TIME_S, CALLS, ITERATIONS = 0.5, 16.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 5, 3, 300
TOUCHES, VISIBLE = (0.05, 0.5, 5.0), 0.12
"""First forces in N, each for 0.2 s, until the speed is seen, in m/s."""


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
    sigma=(0.01, 0.01, 0.05, 0.05),
    longest_s=0.08,
    starts=150,
    tried=3,
    rounds=8,
)


def _course(readings):
    """Forces, places and velocities, up to where the rim caught."""
    seen = [of("object_1", axis) for of in (position, velocity) for axis in (0, 1)]
    raw = recorded(readings, [force("object_1", axis) for axis in (0, 1)], seen)
    lost = np.nonzero(np.hypot(raw.readings[:, 0], raw.readings[:, 1]) > RIM_M - 0.005)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants of a smooth pull at points of the unit cube."""
    spans = [(*BOX[name], part) for name, part in zip(PLAIN, unit, strict=True)]
    values = [low * (high / low) ** part if low > 0 else low + (high - low) * part for low, high, part in spans]
    return dict(zip(PLAIN, values, strict=True))


def _roughly(course, unit):
    """The constants from one leg after the other, from a point of the unit cube or anywhere."""
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        ends = LAWS.advanced("plain", _constants(units), 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (2 * np.array(LAWS.sigma)[:, None])
        return np.vstack([np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1]), units - 0.5])

    if unit is None:
        units = np.random.default_rng(1).random((len(PLAIN), 400))
        unit = units[:, np.argmin(np.log1p(misfits(units) ** 2).sum(axis=0))]
        unit = refined(misfits, unit, 12)
    return refined(misfits, unit, 6)


def _planned(knobs, state, span, reach):
    """Forces for the next legs: of many at random, those that carry the puck far, but not beyond the reach."""
    rng = np.random.default_rng(2)
    size = min(0.999 * FORCE, 0.9 * reach * knobs["m"] * knobs["k"]) * rng.choice([0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    angle = rng.uniform(0, 2 * np.pi, (AHEAD, TRIALS))
    forces = np.array([size * np.cos(angle), size * np.sin(angle)]).transpose(1, 0, 2)
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for held in forces:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held)
            r = np.nan_to_num(np.hypot(states[0], states[1]), nan=9.0)
            value += 3 * np.maximum(np.minimum(r, reach) - FAR_M, 0.0) + 0.2 * r - 1e3 * np.maximum(r - reach, 0.0)
    return forces[:LEGS, :, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_force", object_id="object_1", force_vector=[*np.round(strength, 4).tolist(), 0.0]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Touches until the puck moves, then forces that the model so far chooses."""
    seen = []
    for strength in TOUCHES:
        calls = _push([strength, 0.0], 0.2)
        seen += zip(calls, (yield calls), strict=True)
        if _course(seen).readings[-1, 2] > VISIBLE:
            break
    calls = [*_push([0.0, 0.0], 0.15), *_push([0.0, 0.0], 0.15), *_push([0.0, 0.0], 0.15)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.05
    for _ in range(ITERATIONS - 4):
        course = _course(seen)
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(1.1 / np.sqrt(knobs["k"]), 0.1, 0.5))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        far = float(np.hypot(course.readings[:, 0], course.readings[:, 1]).max())
        reach, reaches = min(reaches[0], 0.05 + 2 * far), reaches[1:] or reaches
        calls = [asked for f in _planned(knobs, course.readings[-1], span, reach) for asked in _push(f, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _predict(structure, knobs):
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


def fit(readings, structure):
    """The answer by the pull of a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """What pulls further out, and whether a force acts across the motion."""
    return knobs["kind"]


def theory(knobs):
    """The largest distance from energy and angular momentum."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """The cord near the hole carried on; the launch speed all spent on the cord, as if launched straight away."""
    k, kind = knobs["k"], knobs["kind"]
    alone = (
        _predict("second", {**knobs, "k2": 0.0})
        if "turning" not in kind
        else _predict("turning second", {**knobs, "k2": 0.0})
    )
    straight = float(np.sqrt(LAUNCH_M**2 + SPEED**2 / k))
    return {"first cord": alone, "straight": [straight, LAUNCH_M * SPEED / straight]}


def stage(task):
    """Push as hard as possible, and read the largest distance."""
    calls = [asked for _ in range(5) for asked in _push([FORCE, 0.0], 0.3)]
    readings = yield calls
    far = max(abs(reading["position"][0]) for reading in readings if "position" in reading)
    yield [answer([far, LAUNCH_M * SPEED / far])]


def batch(task):
    """Pushes to and fro, stronger and stronger, and the same fit."""
    sizes = (0.1, 0.0, 0.2, 0.0, 0.5, 0.0, 1.0, 0.0, 2.0, 0.0, 5.0, 0.0, 10.0, 0.0, 20.0)
    calls = [asked for number, f in enumerate(sizes) for asked in _push([f, 0.3 * f * (-1) ** number], 0.35)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """The same flight in the engine, without the rim."""
    free = engine.changed({"body[rim].pos": (0, 0, 0), "key[start].qpos": (LAUNCH_M, 0), "key[start].qvel": (0, SPEED)})
    path = []
    while len(path) < 3 or path[-1][0] >= path[-2][0]:
        free.step(1)
        x, y, _ = free.pose("object_1").position
        path.append((float(np.hypot(x, y)), float(np.hypot(*free.twist("object_1").linear[:2]))))
    return list(path[-2])
