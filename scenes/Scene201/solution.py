"""Scene 201: lead the puck to places up to the rim, fit each law to the whole course, predict."""

import numpy as np

from scenes.protocol import answer, call

STRUCTURES = {
    "step": ("c", "p", "q", "b", "where", "ratio"),
    "ramp": ("c", "p", "q", "b", "where", "slope"),
    "wave": ("c", "p", "q", "b", "depth", "length", "phase"),
}
BOX = {
    "c": (0.3, 3.0),
    "p": (1.1, 2.9),
    "q": (0.4, 2.2),
    "b": (-1.8, 1.8),
    "where": (2.0, 4.5),
    "ratio": (0.1, 5.0),
    "slope": (-1.2, 1.2),
    "depth": (0.3, 1.2),
    "length": (4.0, 11.0),
    "phase": (-0.3, 6.6),
}
PUCKS, AXES, START = ("object_1",), 2, (0.0, 0.0, 0.0, 0.0)
LONGEST_S, STARTS, TRIED, ROUNDS = 0.13, 300, 6, 15
SIGMA = (0.0025, 0.0025, 0.006, 0.006)
GREATEST_N, LEG_S, LEGS, LOOKS, STIFF, CALM = 2.9, 1.0, 19, 2, 2.5, 1.5
TARGETS = ((5.1, 0.5), (2.4, -0.5), (5.2, -0.3), (-1.0, 0.6), (5.2, 0.4), (3.0, -0.8), (5.0, 0.6))
NEAR_M, SAFE_M = 0.7, 5.1
FAR_FORCE_N, FAST_M_S, FAR_M, SLOW_M_S = 40.0, 4.0, 8.0, 1.0
HEAVY_KG = 1e6
STEP_M = 0.2


def _shape(structure, knobs, x):
    """The sideways force at a place, over that at unit factor."""
    if structure == "step":
        return 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((x - knobs["where"]) / STEP_M))
    if structure == "ramp":
        return 1 + knobs["slope"] * np.maximum(x - knobs["where"], 0.0)
    return 1 + knobs["depth"] * np.sin(2 * np.pi * x / knobs["length"] + knobs["phase"])


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state: drag against a power of the speed, and a force across the way that x changes."""
    x, _, vx, vy = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    drag = knobs["c"] * speed ** (knobs["p"] - 1)
    turn = knobs["b"] * _shape(structure, knobs, x) * speed ** (knobs["q"] - 1)
    return np.array([vx, vy, force[0] - drag * vx + turn * vy, force[1] - drag * vy - turn * vx])


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
    """Guided speed under the far force; the guide's force at speed and at the far place."""
    return [
        float((FAR_FORCE_N / knobs["c"]) ** (1 / knobs["p"])),
        float(knobs["b"] * _shape(structure, knobs, 0.0) * FAST_M_S ** knobs["q"]),
        float(knobs["b"] * _shape(structure, knobs, FAR_M) * SLOW_M_S ** knobs["q"]),
    ]


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
    """The same three situations in the engine, without the rim."""
    guided = engine.changed({"joint[object_1_y].armature": 1e4 * HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.push("object_1", force=np.array([FAR_FORCE_N, 0.0, 0.0]))
    guided.step(guided.whole_steps(10.0))
    return [
        float(guided.twist("object_1").linear[0]),
        float(-_force(engine, (0.0, 0.0), (FAST_M_S, 0.0))[1]),
        float(-_force(engine, (FAR_M, 0.0), (SLOW_M_S, 0.0))[1]),
    ]


def naive(knobs):
    """All forces in proportion to the speed; the same everywhere."""
    low = knobs["c"] * 1.0
    here = knobs["b"] * _shape(knobs["kind"], knobs, 0.0)
    return {
        "linear": [FAR_FORCE_N / low, here * FAST_M_S, _predictions(knobs["kind"], knobs)[2]],
        "everywhere the same": [*_predictions(knobs["kind"], knobs)[:2], here],
    }


def stage(task):
    """Push as the question says."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=10)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    speed = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = speed[0]["velocity"]
    yield [answer([vx * FAR_FORCE_N / 3, -vy * FAST_M_S, -vy])]


BATCH = (
    (2.9, 0.3, 1.2),
    (-1.0, -0.3, 1.2),
    (1.5, -0.3, 1.4),
    (-1.0, 0.3, 1.6),
    (-1.0, 0.0, 1.0),
    (2.9, 0.3, 1.6),
    (0.0, 0.0, 1.6),
    (-2.9, 0.3, 1.6),
)
