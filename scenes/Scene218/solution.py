"""Scene 218: lead the puck round an unseen centre while its field changes, fit each law to the course, predict."""

import numpy as np

from scenes.protocol import answer, call

_COMMON = ("middle_x", "middle_y", "whirl", "width", "pull", "core", "c", "p", "period")
STRUCTURES = {"fading": _COMMON, "growing": _COMMON, "swinging": (*_COMMON, "phase")}
BOX = {
    "middle_x": (1.5, 4.5),
    "middle_y": (-3.0, 3.0),
    "whirl": (-3.5, 3.5),
    "width": (0.3, 3.0),
    "pull": (-2.5, 2.5),
    "core": (0.2, 3.0),
    "c": (0.2, 2.5),
    "p": (1.1, 2.9),
    "period": (9.0, 60.0),
    "phase": (-0.3, 6.6),
}
PUCKS, AXES, START = ("object_1",), 2, (0.0, 0.0, 0.0, 0.0)
LONGEST_S, STARTS, TRIED, ROUNDS = 0.13, 400, 5, 40
SIGMA = (0.003, 0.003, 0.009, 0.009)
GREATEST_N, LEG_S, LEGS, LOOKS, STIFF, CALM = 3.9, 1.2, 19, 2, 2.2, 1.4
TARGETS = ((4.0, 1.5), (2.5, -2.5), (4.9, -0.3), (1.0, 2.0), (2.5, -0.5), (4.5, 2.0), (3.0, 0.5), (-1.0, -0.6))
NEAR_M, SAFE_M = 0.9, 5.1
FAR_M, LATE_S, FAST_M_S = 8.0, 40.0, 3.5
HEAVY_KG = 1e6


def _strength(structure, knobs, time):
    """Factor of the whirl at a time."""
    if structure == "fading":
        return np.exp(-time / knobs["period"])
    if structure == "growing":
        return 1 + time / knobs["period"]
    return np.cos(2 * np.pi * time / knobs["period"] + knobs["phase"])


def _field(structure, knobs, time, x, y):
    """Force on the puck at rest: round the centre and towards it."""
    px, py = x - knobs["middle_x"], y - knobs["middle_y"]
    r = np.sqrt(px**2 + py**2 + 1e-6)
    round_it = _strength(structure, knobs, time) * 2 * knobs["whirl"] * knobs["width"] / (r**2 + knobs["width"] ** 2)
    to_it = knobs["pull"] * np.tanh(r / knobs["core"]) / r
    return -round_it * py - to_it * px, round_it * px - to_it * py


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    fx, fy = _field(structure, knobs, time, x, y)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array([vx, vy, force[0] + fx - drag * vx, force[1] + fy - drag * vy])


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


def _predictions(structure, knobs):
    """Holding force along y late and far away; along x early and far away; resistance to a fast motion."""
    late, early = (_field(structure, knobs, time, -FAR_M, 0.0) for time in (LATE_S, 0.0))
    return [float(-late[1]), float(-early[0]), float(knobs["c"] * FAST_M_S ** knobs["p"])]


def _push(force, duration):
    """A push, looked at in even intervals."""
    look = round(duration / LOOKS / 0.005) * 0.005
    eyes = [call("get_position", object_id="object_1"), call("get_velocity", object_id="object_1")]
    push = call("apply_force", object_id="object_1", force_vector=[*np.round(force, 3).tolist(), 0.0])
    return [push, *([call("step", duration=look), *eyes] * LOOKS)]


def solve(task):
    """Lead the puck to and fro, mostly on the side that the question is about, looking twice during each push."""
    seen, place, velocity, targets = [], np.zeros(2), np.zeros(2), list(TARGETS)
    for leg in range(LEGS):
        if np.hypot(*(targets[0] - place)) < NEAR_M or leg % 4 == 3:
            targets = targets[1:] + targets[:1]
        force, ahead = STIFF * (targets[0] - place) - CALM * velocity, place + LEG_S * velocity
        if np.hypot(*ahead) > SAFE_M:
            force = -GREATEST_N * ahead
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


def _heavy(engine, place, velocity):
    """The engine with a puck so heavy that it stays at a place, or keeps its velocity."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.place("object_1", np.array([*place, 0.05]), {})
    heavy.set_velocity("object_1", np.array([*velocity, 0.0]))
    return heavy


def _force(heavy):
    """Force on the heavy puck during the next time step."""
    before = heavy.twist("object_1").linear
    heavy.step(1)
    return (heavy.twist("object_1").linear - before)[:2] * HEAVY_KG / heavy.timestep


def measure(engine, knobs):
    """The same from forces on a very heavy puck in the engine."""
    far = _heavy(engine, (-FAR_M, 0.0), (0.0, 0.0))
    early = _force(far)
    far.step(far.whole_steps(LATE_S))
    rest, fast = (_force(_heavy(engine, (0.0, 0.0), (0.0, speed))) for speed in (0.0, FAST_M_S))
    return [float(-_force(far)[1]), float(-early[0]), float(rest[1] - fast[1])]


def naive(knobs):
    """The field stays as it is; resistance in proportion to the speed."""
    early = _field(knobs["kind"], knobs, 0.0, -FAR_M, 0.0)
    late, pull, drag = _predictions(knobs["kind"], knobs)
    return {"constant in time": [float(-early[1]), pull, drag], "linear": [late, pull, knobs["c"] * FAST_M_S]}


def stage(task):
    """Wait and hold the puck where it can be held."""
    yield [call("step", duration=1.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    yield [call("step", duration=39.0), call("step", duration=20.0)]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vy, -vx, 8.0])]


BATCH = (
    (2.9, 0.3, 1.2),
    (-1.0, -2.0, 1.2),
    (1.5, 1.5, 1.4),
    (-1.0, 2.0, 1.6),
    (1.0, -2.0, 1.6),
    (2.9, 0.3, 2.0),
    (0.0, 0.0, 4.0),
    (-1.9, -1.9, 4.0),
)
