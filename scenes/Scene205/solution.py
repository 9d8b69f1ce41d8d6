"""Scene 205: steer both pucks to many distances, fit the two one-sided forces and both drags to the course."""

import numpy as np

from scenes.protocol import answer, call

_COMMON = ("a", "reach", "b", "width", "where", "ratio", "c", "p", "d")
STRUCTURES = {"away": _COMMON, "towards": _COMMON, "across": _COMMON}
BOX = {
    "a": (-4.0, 4.0),
    "reach": (0.3, 2.0),
    "b": (0.3, 5.0),
    "width": (0.25, 2.5),
    "where": (2.0, 4.5),
    "ratio": (0.15, 5.0),
    "c": (0.25, 3.0),
    "p": (1.1, 2.9),
    "d": (0.15, 3.0),
}
PUCKS, AXES = ("object_1", "object_2"), 2
START = (-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
LONGEST_S, STARTS, TRIED, ROUNDS = 0.1, 200, 3, 15
SIGMA = (0.006, 0.006, 0.015, 0.015) * 2
"""Of place and velocity of the one puck, then of the other."""
GREATEST_N = 3.9
LEGS, LEG_S = 19, 0.7
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
FAR_FORCE_N, FAR_M, AWAY_M = 25.0, 9.0, 20.0
HEAVY_KG = 1e6
STEP_M = 0.2


def _drawn(knobs, r):
    """Force on object_1 towards object_2 at a distance."""
    return knobs["a"] * r / knobs["reach"] * np.exp(1 - r / knobs["reach"])


def _met(knobs, r):
    """Size of the force on object_2 at a distance."""
    beyond = 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((r - knobs["where"]) / STEP_M))
    return 2 * knobs["b"] * knobs["width"] * r / (r**2 + knobs["width"] ** 2) * beyond


def _rates(structure, knobs, time, state, force):
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
            force[0] + drawn * dx - drag * vx,
            force[1] + drawn * dy - drag * vy,
            other_vx,
            other_vy,
            force[2] + met * px - knobs["d"] * other_vx,
            force[3] + met * py - knobs["d"] * other_vy,
        ]
    )


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


def _predictions(_structure, knobs):
    """Speed of object_1 alone; work of drawing it away from object_2; force on object_2 at the far distance."""
    a, reach, far = knobs["a"], knobs["reach"], AWAY_M / knobs["reach"]
    return [
        float((FAR_FORCE_N / knobs["c"]) ** (1 / knobs["p"])),
        float(a * np.e * reach * (1 - (1 + far) * np.exp(-far))),
        float(_met(knobs, FAR_M)),
    ]


def _eyes():
    return [call(tool, object_id=name) for name in PUCKS for tool in ("get_position", "get_velocity")]


def _steered(target, place, velocity):
    """A force that leads towards a target, and calms what is too fast."""
    force = 2.0 * (np.array(target) - place) - 2.1 * np.array(velocity)
    size = np.hypot(*force)
    return [*np.round(force * min(1.0, GREATEST_N / max(size, 1e-6)), 3).tolist(), 0.0]


def solve(task):
    """Lead the pucks to pairs of places, looking after each push."""
    seen, state = [], np.array(START)
    for leg in range(LEGS):
        targets = TARGETS[leg // 2 % len(TARGETS)]
        calls = [
            call("apply_force", object_id=name, force_vector=_steered(target, now[:2], now[2:]))
            for name, target, now in zip(PUCKS, targets, state.reshape(2, 4), strict=True)
        ]
        calls += [call("step", duration=LEG_S), *_eyes()]
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        state = np.concatenate([(reading.get("position") or reading["velocity"])[:2] for reading in readings[-4:]])
    yield [answer(_best(seen))]


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
    speed, work, _ = _predictions("", knobs)
    return {
        "reaction": [speed, work, abs(float(_drawn(knobs, FAR_M)))],
        "linear": [FAR_FORCE_N / knobs["c"], float(_drawn(knobs, 1.0)) * AWAY_M, float(_met(knobs, 1.0)) / FAR_M],
    }


def stage(task):
    """Push as the question says, and read what happens."""
    yield [call("apply_force", object_id="object_1", force_vector=[-FAR_FORCE_N, 0, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[-3.9, 0, 0]), call("step", duration=0.8)]
    seen = yield _eyes()
    yield [answer([-seen[1]["velocity"][0] * FAR_FORCE_N / 3.9, 1.0, abs(seen[3]["velocity"][0])])]


def batch(task):
    """Pushes of fixed sizes and lengths, and the same fit."""
    calls = []
    for first, second, lasting in BATCH:
        calls += [
            *(
                call("apply_force", object_id=name, force_vector=[*force, 0.0])
                for name, force in zip(PUCKS, (first, second), strict=True)
            ),
            call("step", duration=lasting),
            *_eyes(),
        ]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


BATCH = (
    ((0.5, 0.0), (0.0, 0.5), 0.25),
    ((1.0, 0.0), (-1.0, 0.0), 0.25),
    ((2.0, 0.0), (-2.0, 0.0), 0.3),
    ((-2.0, 0.5), (2.0, -0.5), 0.4),
    ((-3.0, 0.5), (3.0, -0.5), 0.4),
    ((1.0, -1.0), (-1.0, 1.0), 0.5),
    ((3.0, 0.5), (-3.0, 0.0), 0.7),
    ((0.0, -1.0), (0.0, 1.0), 0.7),
)
