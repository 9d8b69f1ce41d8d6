"""Scene 205: learn both masses, steer the pucks to many distances, fit the one-sided forces and the drags, predict."""

import numpy as np

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.protocol import answer, call

_COMMON = ("m1", "m2", "a", "reach", "b", "width", "where", "ratio", "c", "p", "d")
STRUCTURES = {"away": _COMMON, "towards": _COMMON, "across": _COMMON}
BOX = {
    "m1": (0.2, 8.0),
    "m2": (0.2, 8.0),
    "a": (-4.0, 4.0),
    "reach": (0.3, 2.0),
    "b": (0.3, 5.0),
    "width": (0.25, 2.5),
    "where": (2.0, 4.5),
    "ratio": (0.2, 4.0),
    "c": (0.25, 2.5),
    "p": (1.1, 2.7),
    "d": (0.2, 2.5),
}
PUCKS, AXES = ("object_1", "object_2"), (0, 1)
START = (-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
LIGHTEST_KG, HEAVIEST_KG, HASTE = 0.3, 6.0, 3.9
LEGS, LEG_S = 19, 0.85
TARGETS = (
    ((-0.6, 0.2), (0.4, 0.0)),
    ((0.8, 0.0), (0.2, 0.4)),
    ((3.2, 0.4), (-1.5, -0.5)),
    ((3.2, -0.4), (-3.0, 0.0)),
    ((0.4, -0.2), (-3.2, 0.3)),
    ((-2.0, 0.4), (1.0, -0.6)),
    ((-3.2, -0.5), (2.9, 0.2)),
    ((-2.0, 0.4), (3.2, -0.3)),
    ((1.4, 0.2), (0.6, 0.0)),
    ((1.4, 0.2), (0.6, 0.0)),
)
FAR_FORCE_N, FAR_M, AWAY_M = 60.0, 9.0, 20.0
HEAVY_KG, STEP_M = 1e6, 0.2


def _drawn(knobs, r):
    """Force on object_1 towards object_2 at a distance, per kilogram."""
    return knobs["a"] * r / knobs["reach"] * np.exp(1 - r / knobs["reach"])


def _met(knobs, r):
    """Force on object_2 at a distance, per kilogram."""
    beyond = 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((r - knobs["where"]) / STEP_M))
    return 2 * knobs["b"] * knobs["width"] * r / (r**2 + knobs["width"] ** 2) * beyond


def _rates(structure, knobs, time, state, forces):
    """Time derivative of the state of both pucks."""
    x, y, vx, vy, other_x, other_y, other_vx, other_vy = state
    dx, dy = other_x - x, other_y - y
    r = np.sqrt(dx**2 + dy**2 + 1e-12)
    drawn, met = _drawn(knobs, r) / r, _met(knobs, r) / r
    px, py = {"away": (dx, dy), "towards": (-dx, -dy), "across": (-dy, dx)}[structure]
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array(
        [
            vx,
            vy,
            forces[0] / knobs["m1"] + drawn * dx - drag * vx,
            forces[1] / knobs["m1"] + drawn * dy - drag * vy,
            other_vx,
            other_vy,
            forces[2] / knobs["m2"] + met * px - knobs["d"] * other_vx,
            forces[3] / knobs["m2"] + met * py - knobs["d"] * other_vy,
        ]
    )


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=START,
    sigma=(0.005, 0.005, 0.012, 0.012) * 2,
    longest_s=0.12,
    starts=500,
    tried=4,
    rounds=15,
)


def _course(readings):
    """Pushes on both pucks and what was read after them."""
    seen = [read(name, axis) for name in PUCKS for read in (position, velocity) for axis in AXES]
    return recorded(readings, [force(name, axis) for name in PUCKS for axis in AXES], seen)


def fit(readings, structure):
    """The answer of the best fit of a structure."""
    return predict(structure, LAWS.fitted(_course(readings), structure)[1])


def predict(_structure, knobs):
    """Speed of object_1 alone; work of drawing it away from object_2; force on object_2 at the far distance."""
    reach, far = knobs["reach"], AWAY_M / knobs["reach"]
    return [
        float((FAR_FORCE_N / knobs["m1"] / knobs["c"]) ** (1 / knobs["p"])),
        float(knobs["m1"] * knobs["a"] * np.e * reach * (1 - (1 + far) * np.exp(-far))),
        float(knobs["m2"] * abs(_met(knobs, FAR_M))),
    ]


def _eyes():
    return [call(tool, object_id=name) for name in PUCKS for tool in ("get_position", "get_velocity")]


def _pushed(pushes, lasting):
    """Pushes on both pucks, held for a while, and a look at both."""
    calls = [
        call("apply_force", object_id=name, force_vector=[*np.round(push, 3).tolist(), 0.0])
        for name, push in zip(PUCKS, pushes, strict=True)
    ]
    return [*calls, call("step", duration=lasting), *_eyes()]


def _steered(target, place, speed):
    """A push per kilogram that leads towards a target, and calms what is too fast."""
    push = 2.0 * (np.array(target) - place) - 2.1 * speed
    return push * min(1.0, HASTE / max(float(np.hypot(*push)), 1e-6))


def _masses(course):
    """Masses so far, as if there were a drag and constant forces along and across the line between the pucks."""
    states = np.vstack([START, course.readings])
    before, after, middle = states[:-1], states[1:], (states[:-1] + states[1:]) / 2
    line = middle[:, 4:6] - middle[:, 0:2]
    line = line / np.hypot(*line.T)[:, None]
    across = np.column_stack([-line[:, 1], line[:, 0]])
    found = []
    for first in (0, 4):
        push = course.controls[:, first // 2 : first // 2 + 2]
        motion = middle[:, first + 2 : first + 4]
        rows = np.array([part.T.ravel() for part in (push, motion, line, across)]).T
        times = np.tile(course.durations, 2)[:, None] / LAWS.sigma[2]
        changes = (after - before)[:, first + 2 : first + 4].T.ravel() / LAWS.sigma[2]
        weak = 0.5 * np.eye(4)
        slopes = np.linalg.lstsq(np.vstack([rows * times, weak]), np.concatenate([changes, np.zeros(4)]), rcond=None)[0]
        found.append(1 / np.clip(slopes[0], 1 / HEAVIEST_KG, 1 / LIGHTEST_KG))
    return np.array(found)


def solve(task):
    """Begin gently, then lead the pucks to pairs of places with forces that suit their masses."""
    seen, state, masses = [], np.array(START), np.full(2, LIGHTEST_KG)
    for leg in range(LEGS):
        pairs = zip(masses, TARGETS[leg // 2 % len(TARGETS)], state.reshape(2, 4), strict=True)
        calls = _pushed([mass * _steered(target, now[:2], now[2:]) for mass, target, now in pairs], LEG_S)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        course = _course(seen)
        state, masses = course.readings[-1], np.minimum(_masses(course), 3 * masses)
    yield [answer(predict(*LAWS.best(course)))]


def batch(task):
    """Pushes of fixed sizes and lengths, and the same fit."""
    calls = [asked for first, second, lasting in BATCH for asked in _pushed((first, second), lasting)]
    readings = yield calls
    yield [answer(predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


BATCH = (
    ((0.5, 0.0), (0.0, 0.5), 0.25),
    ((1.0, 0.0), (-1.0, 0.0), 0.25),
    ((2.0, 0.0), (-2.0, 0.0), 0.3),
    ((-2.0, 0.5), (2.0, -0.5), 0.4),
    ((-3.0, 0.5), (3.0, -0.5), 0.4),
    ((1.0, -1.0), (-1.0, 1.0), 0.5),
    ((5.0, 0.5), (-5.0, 0.0), 0.7),
    ((0.0, -1.0), (0.0, 1.0), 0.7),
)


def _held(engine, places, body):
    """Force on a puck, both held at rest at places by a huge inertia, in the engine."""
    heavy = engine.changed({f"joint[{name}_{axis}].armature": HEAVY_KG for name in PUCKS for axis in "xy"})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    for name, place in zip(PUCKS, places, strict=True):
        heavy.place(name, np.array([*place, 0.05]), {})
    heavy.step(1)
    return heavy.twist(body).linear[:2] * HEAVY_KG / heavy.timestep


def measure(engine, knobs):
    """The three situations in the engine, without the rim."""
    alone = engine.changed()
    alone.place("gate", np.array([0.0, 0.0, 1.0]), {})
    alone.place("object_2", np.array([1e4, 1e4, 0.05]), {})
    alone.push("object_1", force=np.array([FAR_FORCE_N, 0.0, 0.0]))
    alone.step(alone.whole_steps(20.0))
    ways = np.linspace(0, AWAY_M**0.5, 61) ** 2
    pulls = [_held(engine, ((-way, 0.0), (0.0, 0.0)), "object_1")[0] for way in ways]
    slope = np.array(pulls) * 2 * np.sqrt(ways)
    work = np.sum((slope[1:] + slope[:-1]) / 2 * np.diff(np.sqrt(ways)))
    return [
        float(alone.twist("object_1").linear[0]),
        float(work),
        float(np.hypot(*_held(engine, ((0.0, 0.0), (FAR_M, 0.0)), "object_2"))),
    ]


def naive(knobs):
    """Action equals reaction; all in proportion to the speed, and forces as at 1 m."""
    speed, work, _ = predict("", knobs)
    far = knobs["m1"] * abs(float(_drawn(knobs, FAR_M)))
    return {
        "reaction": [speed, work, far],
        "linear": [FAR_FORCE_N / knobs["m1"] / knobs["c"], float(knobs["m1"] * _drawn(knobs, 1.0)) * AWAY_M, far],
    }


def stage(task):
    """Push as the question says, and read what happens."""
    yield [call("apply_force", object_id="object_1", force_vector=[-FAR_FORCE_N, 0, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[-3.9, 0, 0]), call("step", duration=0.8)]
    seen = yield _eyes()
    yield [answer([-seen[1]["velocity"][0] * FAR_FORCE_N / 3.9, 1.0, abs(seen[3]["velocity"][0])])]
