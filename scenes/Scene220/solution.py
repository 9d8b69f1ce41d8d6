"""Scene 220: lead the puck about while two laws take turns, fit each pair of laws to the course, predict."""

import numpy as np

from scenes.protocol import answer, call

_COMMON = ("period", "phase", "middle_x", "middle_y", "pull", "n", "c", "p")
STRUCTURES = {"wind": (*_COMMON, "wind", "angle"), "turn": (*_COMMON, "turn"), "brake": (*_COMMON, "brake")}
BOX = {
    "period": (2.5, 8.0),
    "phase": (-0.3, 6.6),
    "middle_x": (1.5, 4.5),
    "middle_y": (-2.5, 2.5),
    "pull": (-2.5, 2.5),
    "n": (0.2, 1.7),
    "c": (0.3, 2.5),
    "p": (1.1, 2.8),
    "wind": (0.3, 2.5),
    "angle": (-0.4, 6.7),
    "turn": (-3.5, 3.5),
    "brake": (0.3, 4.0),
}
PUCKS, AXES, START = ("object_1",), 2, (0.0, 0.0, 0.0, 0.0)
LONGEST_S, STARTS, TRIED, ROUNDS = 0.13, 800, 8, 15
SIGMA = (0.003, 0.003, 0.008, 0.008)
GREATEST_N, LEG_S, LEGS, LOOKS, STIFF, CALM = 3.9, 1.0, 19, 2, 1.6, 1.6
TARGETS = ((4.5, 0.5), (1.0, -1.5), (-3.8, -0.6), (2.4, 0.8), (4.0, -1.4), (-2.5, 1.4))
NEAR_M, SAFE_M = 0.9, 4.8
ROUNDS_ASKED, FAR_M, FAST_M_S = 50, 10.0, 5.0
HEAVY_KG = 1e6
SCALE_M, BLUR = 2.0, 0.15


def _turns(knobs, time):
    """Share of the first law at a time."""
    return 0.5 + 0.5 * np.tanh(np.sin(2 * np.pi * time / knobs["period"] + knobs["phase"]) / BLUR)


def _drawn(knobs, x, y):
    """Force of the first law on a puck at a place."""
    px, py = x - knobs["middle_x"], y - knobs["middle_y"]
    r = np.sqrt(px**2 + py**2 + 1e-4)
    size = knobs["pull"] * (r / SCALE_M) ** knobs["n"] / r
    return -size * px, -size * py


def _other(structure, knobs, vx, vy):
    """Force of the second law on a puck with a velocity."""
    if structure == "wind":
        return knobs["wind"] * np.cos(knobs["angle"]), knobs["wind"] * np.sin(knobs["angle"])
    if structure == "turn":
        return knobs["turn"] * vy, -knobs["turn"] * vx
    return -knobs["brake"] * vx, -knobs["brake"] * vy


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    share, drawn, other = _turns(knobs, time), _drawn(knobs, x, y), _other(structure, knobs, vx, vy)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array(
        [
            vx,
            vy,
            force[0] + share * drawn[0] + (1 - share) * other[0] - drag * vx,
            force[1] + share * drawn[1] + (1 - share) * other[1] - drag * vy,
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


def _predictions(structure, knobs):
    """Time of many rounds; mean holding force far away; greatest resistance to a fast motion."""
    mean = (_drawn(knobs, -FAR_M, 0.0)[0] + _other(structure, knobs, 0.0, 0.0)[0]) / 2
    rest, fast = (_other(structure, knobs, 0.0, speed) for speed in (0.0, FAST_M_S))
    resisting = knobs["c"] * FAST_M_S ** knobs["p"]
    greatest = np.hypot(fast[0] - rest[0], fast[1] - rest[1] - resisting)
    return [float(ROUNDS_ASKED * knobs["period"]), float(-mean), float(greatest)]


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


def _forces(engine, knobs, place, velocity):
    """Forces on a puck at a place, or moving through it, at many times of one round, in the engine."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.set_velocity("object_1", np.array([*velocity, 0.0]))
    steps = round(knobs["period"] / heavy.timestep)
    forces = []
    for _ in range(steps):
        heavy.place("object_1", np.array([*place, 0.05]), {})
        before = heavy.twist("object_1").linear
        heavy.step(1)
        forces.append((heavy.twist("object_1").linear - before)[:2] * HEAVY_KG / heavy.timestep)
    return np.array(forces)


def measure(engine, knobs):
    """The round's time is what it is; the forces over one round in the engine."""
    mean = _forces(engine, knobs, (-FAR_M, 0.0), (0.0, 0.0))[:, 0].mean()
    rest, fast = (_forces(engine, knobs, (0.0, 0.0), (0.0, speed)) for speed in (0.0, FAST_M_S))
    greatest = np.hypot(*(fast - rest).T).max()
    return [float(ROUNDS_ASKED * knobs["period"]), float(-mean), float(greatest)]


def naive(knobs):
    """The first law all the time; resistance in proportion to the speed."""
    rounds, _, greatest = _predictions(knobs["kind"], knobs)
    return {
        "always the same": [rounds, float(-_drawn(knobs, -FAR_M, 0.0)[0]), greatest],
        "linear": [rounds, float(-_drawn(knobs, -FAR_M, 0.0)[0] / 2), float(knobs["c"] * FAST_M_S)],
    }


def stage(task):
    """Wait for as many rounds; else read the first seconds."""
    yield [call("step", duration=30.0), call("step", duration=100.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    yield [answer([200.0, -float(seen[0]["velocity"][0]), 25.0])]


BATCH = (
    (2.0, 0.3, 1.0),
    (-1.0, -1.0, 1.2),
    (-1.5, 1.5, 1.4),
    (1.0, 1.0, 1.6),
    (-1.0, -2.0, 1.6),
    (2.9, 0.3, 1.6),
    (0.0, 0.0, 1.0),
    (-2.9, 1.0, 1.6),
)
