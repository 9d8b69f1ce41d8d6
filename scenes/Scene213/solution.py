"""Scene 213: lead the puck in many directions to places up to the rim, fit each law to the course, predict."""

import numpy as np
from scipy.optimize import root

from scenes.protocol import answer, call

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
PUCKS, AXES, START = ("object_1",), 2, (0.0, 0.0, 0.0, 0.0)
LONGEST_S, STARTS, TRIED, ROUNDS = 0.1, 300, 8, 15
SIGMA = (0.004, 0.004, 0.012, 0.012)
GREATEST_N, LEG_S, LEGS, LOOKS, STIFF, CALM = 2.9, 1.0, 19, 2, 2.5, 1.5
TARGETS = ((4.8, 1.0), (3.5, -2.0), (4.9, -0.3), (0.5, 1.5), (-1.5, -0.6), (4.7, -1.0), (4.0, 1.5))
NEAR_M = 0.8
FAR_FORCE_N, FAR_M, FAST_M_S = 30.0, 8.0, 10.0
HEAVY_KG = 1e6
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


def _advanced(structure, knobs, time, state, duration, force):
    """The state after a leg (Runge and Kutta); all arguments may be arrays, of legs and of trial knobs."""
    count = max(1, int(np.ceil(np.max(duration) / LONGEST_S)))
    h = duration / count
    for _ in range(count):
        a = _rates(structure, knobs, time, state, force)
        b = _rates(structure, knobs, time + h / 2, state + h / 2 * a, force)
        c = _rates(structure, knobs, time + h / 2, state + h / 2 * b, force)
        d = _rates(structure, knobs, time + h, state + h * c, force)
        state, time = state + h / 6 * (a + 2 * b + 2 * c + d), time + h
    return state


def _course(structure, knobs, legs):
    """States at the end of each leg, one leg after the other from rest, for arrays of trial knobs."""
    state = np.array(START)[:, None] + np.zeros(len(next(iter(knobs.values()))))
    time, states = 0.0, []
    for duration, force in legs:
        state, time = _advanced(structure, knobs, time, state, duration, force), time + duration
        states.append(state)
    return np.array(states)


def _leg_by_leg(structure, knobs, legs, values):
    """States at the end of each leg, each begun from the readings before it, for arrays of trial knobs."""
    durations = np.array([duration for duration, _ in legs])[:, None]
    forces = np.array([force for _, force in legs]).T[:, :, None]
    starts = np.vstack([START, values[:-1]]).T[:, :, None] + np.zeros(len(next(iter(knobs.values()))))
    states = _advanced(structure, knobs, np.cumsum(durations, axis=0) - durations, starts, durations, forces)
    return states.transpose(1, 0, 2)


def _record(seen):
    """Legs (duration, forces) and the readings after each of them."""
    forces, legs, values = dict.fromkeys(PUCKS, [0.0] * AXES), [], []
    for request, reading in seen:
        if request.tool == "apply_force":
            forces[request.arguments["object_id"]] = request.arguments["force_vector"][:AXES]
        elif request.tool == "step":
            legs.append((request.arguments["duration"], [part for push in forces.values() for part in push]))
            values.append([])
        else:
            values[-1] += (reading.get("position") or reading["velocity"])[:AXES]
    return legs, np.array(values)


def _refined(residuals, unit):
    """Least squares from a start in units of the box (Levenberg and Marquardt), with many trial steps at once."""
    size = len(unit)
    for _ in range(ROUNDS):
        found = residuals(unit[:, None] + 1e-4 * np.column_stack([np.zeros(size), np.eye(size)]))
        slope = (found[:, 1:] - found[:, :1]) / 1e-4
        normal, pull, cost = slope.T @ slope, slope.T @ found[:, 0], found[:, 0] @ found[:, 0]
        brakes = [np.diag(brake * (np.diag(normal) + 1e-6)) for brake in 10.0 ** np.arange(-5, 3)]
        steps = [np.linalg.lstsq(normal + brake, pull, rcond=None)[0] for brake in brakes]
        trials = np.clip(unit[:, None] - np.column_stack(steps), -0.1, 1.1)
        costs = (residuals(trials) ** 2).sum(axis=0)
        best = int(np.argmin(costs))
        if costs[best] < cost:
            unit = trials[:, best]
        if costs[best] > 0.999 * cost:
            break
    return unit


def _fitted(seen, structure):
    """Chi-square and knobs of the best fit of a structure: first leg by leg, then of the whole course."""
    legs, values = _record(seen)
    names = STRUCTURES[structure]
    low, high = np.array([BOX[name] for name in names]).T

    def knobs(units):
        pairs = zip(names, low, high, units, strict=True)
        return {name: a * (b / a) ** unit if a > 0 else a + (b - a) * unit for name, a, b, unit in pairs}

    def residuals(units, whole=False):
        with np.errstate(all="ignore"):
            states = (
                _course(structure, knobs(units), legs) if whole else _leg_by_leg(structure, knobs(units), legs, values)
            )
            misfit = (states[:, : len(SIGMA)] - values[:, :, None]) / np.array(SIGMA)[:, None]
        misfit = np.clip(np.nan_to_num(misfit, nan=1e4), -1e4, 1e4)
        return np.vstack([misfit.reshape(-1, units.shape[1]), 0.3 * (units - 0.5)])

    starts = np.random.default_rng(0).random((len(names), STARTS))
    order = np.argsort(np.log1p(residuals(starts) ** 2).sum(axis=0))[:TRIED]
    found = [_refined(residuals, starts[:, start]) for start in order]
    unit = min(found, key=lambda unit: (residuals(unit[:, None]) ** 2).sum())
    unit = _refined(lambda units: residuals(units, whole=True), unit)
    cost = float((residuals(unit[:, None], whole=True) ** 2).sum())
    return cost, {name: float(value) for name, value in knobs(unit).items()}


def fit(readings, structure):
    """Predictions of the best fit of a structure."""
    return _predictions(structure, _fitted(readings, structure)[1])


def _best(readings):
    """Predictions of the structure that fits best, with a penalty for each knob."""
    fits = {structure: _fitted(readings, structure) for structure in STRUCTURES}
    structure = min(fits, key=lambda name: fits[name][0] + 4 * len(STRUCTURES[name]))
    return _predictions(structure, fits[structure][1])


def structure(knobs):
    """Label of the drawn structure."""
    return knobs["kind"]


def theory(knobs):
    """Predictions from the drawn law."""
    return _predictions(knobs["kind"], knobs)


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


def _predictions(structure, knobs):
    """Direction of the drift far away; speed along the grain, and resistance across it, at the origin."""
    knobs = {name: value for name, value in knobs.items() if name in BOX}
    easy = _easy_speed(lambda v: knobs["c"] * v + knobs["d"] * v**2)
    hard = knobs["c"] * knobs["more"] * FAST_M_S + knobs["d"] * knobs["steeper"] * FAST_M_S**2
    return [_drift(lambda v: _resistance(structure, knobs, FAR_M, 0.0, *v)), float(easy), float(hard)]


def _push(force, duration):
    """A push, looked at in even intervals."""
    look = round(duration / LOOKS / 0.005) * 0.005
    eyes = [call("get_position", object_id="object_1"), call("get_velocity", object_id="object_1")]
    push = call("apply_force", object_id="object_1", force_vector=[*np.round(force, 3).tolist(), 0.0])
    return [push, *([call("step", duration=look), *eyes] * LOOKS)]


def solve(task):
    """Lead the puck to and fro, mostly on the side that the question is about, looking twice during each push."""
    seen, place, velocity, targets = [], np.zeros(2), np.zeros(2), list(TARGETS)
    for _ in range(LEGS):
        if np.hypot(*(targets[0] - place)) < NEAR_M:
            targets = targets[1:] + targets[:1]
        force = STIFF * (targets[0] - place) - CALM * velocity
        calls = _push(force * min(1.0, GREATEST_N / np.hypot(*force)), LEG_S)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        place, velocity = np.array(readings[-2]["position"][:2]), np.array(readings[-1]["velocity"][:2])
    yield [answer(_best(seen))]


def batch(task):
    """Pushes to and fro of fixed lengths, and the same fit."""
    calls = [asked for x, y, lasting in BATCH for asked in _push(np.array([x, y]), lasting)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


def _force(engine, place, velocity=(0.0, 0.0)):
    """Force on the puck at a place and a velocity, which a huge inertia keeps, in the engine."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    half = np.array(velocity) * heavy.timestep / 2
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.place("object_1", np.array([*(np.array(place) - half), 0.05]), {})
    heavy.set_velocity("object_1", np.array([*velocity, 0.0]))
    before = heavy.twist("object_1").linear
    heavy.step(1)
    return (heavy.twist("object_1").linear - before)[:2] * HEAVY_KG / heavy.timestep


def measure(engine, knobs):
    """The same from forces on the moving puck in the engine."""
    ex, ey = (float(part) for part in _grain(knobs["kind"], knobs, 0.0, 0.0))
    easy = _easy_speed(lambda v: -_force(engine, (0.0, 0.0), (v * ex, v * ey)) @ (ex, ey))
    hard = _force(engine, (0.0, 0.0), (-FAST_M_S * ey, FAST_M_S * ex)) @ (ey, -ex)
    return [_drift(lambda v: _force(engine, (FAR_M, 0.0), tuple(v))), float(easy), float(hard)]


def naive(knobs):
    """The grain everywhere as at the origin; the same resistance in all directions."""
    _, easy, hard = _predictions(knobs["kind"], knobs)
    ex, ey = (float(part) for part in _grain(knobs["kind"], knobs, 0.0, 0.0))
    uniform = {**knobs, "angle": float(np.arctan2(ey, ex)), "turn": 0.0, "where": 100.0}
    return {
        "everywhere the same": [_predictions("fault", uniform)[0], easy, hard],
        "same in all directions": [0.0, easy, knobs["c"] * FAST_M_S + knobs["d"] * FAST_M_S**2],
    }


def stage(task):
    """Push as the question says; else with what one has."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[2.9, 0, 0]), call("step", duration=2)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([float(np.arctan2(vy, vx)), float(np.hypot(vx, vy) * 10), 29.0 / max(0.1, float(np.hypot(vx, vy)))])]


BATCH = (
    (2.9, 0.3, 1.2),
    (-1.0, -2.0, 1.2),
    (1.5, 1.5, 1.4),
    (-1.0, 2.0, 1.6),
    (1.0, -2.0, 1.0),
    (2.9, 0.3, 1.6),
    (0.0, 0.0, 1.0),
    (-1.9, -1.9, 1.6),
)
