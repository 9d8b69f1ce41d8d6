"""Scene 213: lead the puck in many directions to places up to the rim, fit each law to the course, predict."""

import numpy as np
from scipy.optimize import root

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("c", "d", "more", "steeper", "angle")
STRUCTURES = {
    "fault": (*_COMMON, "where", "turn"),
    "bend": (*_COMMON, "where", "curve"),
    "rings": ("c", "d", "more", "steeper", "middle_x", "middle_y"),
}
BOX = {
    "c": (0.1, 2.0),
    "d": (0.05, 1.5),
    "more": (1.1, 6.0),
    "steeper": (1.1, 6.0),
    "angle": (-0.2, 3.4),
    "where": (1.5, 4.0),
    "turn": (-1.7, 1.7),
    "curve": (-0.9, 0.9),
    "middle_x": (1.5, 5.0),
    "middle_y": (-3.5, 3.5),
}
GREATEST_N, LEG_S, STIFF, CALM = 2.9, 1.0, 2.5, 1.5
TARGETS = ((4.8, 1.0), (3.5, -2.0), (4.9, -0.3), (0.5, 1.5), (-1.5, -0.6), (4.7, -1.0), (4.0, 1.5))
NEAR_M = 0.8
FAR_FORCE_N, FAR_M, FAST_M_S = 30.0, 8.0, 10.0
STEP_M = 0.2


def _grain(structure, knobs, x, y):
    """Direction of the grain as a unit vector."""
    if structure == "rings":
        across, along = x - knobs["middle_x"], y - knobs["middle_y"]
        r = np.sqrt(across**2 + along**2 + 1e-4)
        return -along / r, across / r
    if structure == "fault":
        angle = knobs["angle"] + knobs["turn"] * (0.5 + 0.5 * np.tanh((x - knobs["where"]) / STEP_M))
    else:
        angle = knobs["angle"] + knobs["curve"] * np.maximum(x - knobs["where"], 0.0)
    return np.cos(angle), np.sin(angle)


def _resistance(structure, knobs, x, y, vx, vy):
    """Force of the floor on the puck."""
    ex, ey = _grain(structure, knobs, x, y)
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    along, across = vx * ex + vy * ey, vy * ex - vx * ey
    easy = (knobs["c"] + knobs["d"] * speed) * along
    hard = (knobs["c"] * knobs["more"] + knobs["d"] * knobs["steeper"] * speed) * across
    return -easy * ex + hard * ey, -easy * ey - hard * ex


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    fx, fy = _resistance(structure, knobs, x, y, vx, vy)
    return np.array([vx, vy, force[0] + fx, force[1] + fy])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.004, 0.004, 0.012, 0.012),
    longest_s=0.1,
    starts=300,
    tried=8,
    rounds=15,
)


def _easy_speed(resistance):
    """Speed at which a resistance that grows with the speed equals the far force, by halving."""
    low, high = 0.0, 400.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if resistance(middle) < FAR_FORCE_N else (low, middle)
    return low


def _drift(resistance):
    """Direction [rad] of the steady motion under the far force along x, where the floor resists so."""
    found = root(lambda v: np.array(resistance(v)) + np.array([FAR_FORCE_N, 0.0]), np.array([3.0, 0.0]))
    return float(np.arctan2(found.x[1], found.x[0]))


def predict(structure, knobs):
    """Direction of the drift far away; speed along the grain, and resistance across it, at the origin."""
    knobs = {name: value for name, value in knobs.items() if name in BOX}
    easy = _easy_speed(lambda v: knobs["c"] * v + knobs["d"] * v**2)
    hard = knobs["c"] * knobs["more"] * FAST_M_S + knobs["d"] * knobs["steeper"] * FAST_M_S**2
    return [_drift(lambda v: _resistance(structure, knobs, FAR_M, 0.0, *v)), float(easy), float(hard)]


def _steer(place, velocity, target):
    """A force towards a target, like that of a damped spring."""
    force = STIFF * (target - place) - CALM * velocity
    return force * min(1.0, GREATEST_N / np.hypot(*force))


def measure(engine, knobs):
    """The same from forces on the moving puck in the engine."""
    ex, ey = (float(part) for part in _grain(knobs["kind"], knobs, 0.0, 0.0))
    easy = _easy_speed(lambda v: -force_on_puck(engine, (0.0, 0.0), (v * ex, v * ey)) @ (ex, ey))
    hard = force_on_puck(engine, (0.0, 0.0), (-FAST_M_S * ey, FAST_M_S * ex)) @ (ey, -ex)
    return [_drift(lambda v: force_on_puck(engine, (FAR_M, 0.0), tuple(v))), float(easy), float(hard)]


def naive(knobs):
    """The grain everywhere as at the origin; the same resistance in all directions."""
    _, easy, hard = predict(knobs["kind"], knobs)
    ex, ey = (float(part) for part in _grain(knobs["kind"], knobs, 0.0, 0.0))
    uniform = {**knobs, "angle": float(np.arctan2(ey, ex)), "turn": 0.0, "where": 100.0}
    return {
        "everywhere the same": [predict("fault", uniform)[0], easy, hard],
        "same in all directions": [0.0, easy, knobs["c"] * FAST_M_S + knobs["d"] * FAST_M_S**2],
    }


def stage(task):
    """Push as the question says; else with what one has."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[2.9, 0, 0]), call("step", duration=2)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([float(np.arctan2(vy, vx)), float(np.hypot(vx, vy) * 10), 29.0 / max(0.1, float(np.hypot(vx, vy)))])]


FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=TARGETS,
    near_m=NEAR_M,
    leg_s=LEG_S,
    steer=_steer,
    fixed_pushes=(
        (2.9, 0.3, 1.2),
        (-1.0, -2.0, 1.2),
        (1.5, 1.5, 1.4),
        (-1.0, 2.0, 1.6),
        (1.0, -2.0, 1.0),
        (2.9, 0.3, 1.6),
        (0.0, 0.0, 1.0),
        (-1.9, -1.9, 1.6),
    ),
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
