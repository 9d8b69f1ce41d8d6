"""Scene 202: learn the mass, lead the puck round and round in both senses, fit each law of the count, predict."""

import numpy as np

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.fitting import refined
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "c", "p", "pull", "n", "middle_x", "middle_y", "k", "slack")
STRUCTURES = {"winds": _COMMON, "left": _COMMON, "right": _COMMON, "fades": (*_COMMON, "lapse")}
BOX = {
    "m": (0.03, 40.0),
    "c": (0.3, 1.6),
    "p": (1.1, 2.5),
    "pull": (0.3, 2.0),
    "n": (-1.4, 1.0),
    "middle_x": (-1.7, 1.7),
    "middle_y": (-1.7, 1.7),
    "k": (0.1, 0.6),
    "slack": (3.0, 7.5),
    "lapse": (5.0, 25.0),
}
CORE_M, SCALE_M, BLUR = 0.3, 2.0, 0.2
SQUARES = ((6.0, 60.0, 8, 1), (9.0, 90.0, 5, -1))
FAST_M_S = 12.0
HEAVY_KG = 1e8
PUSHES, LEARNT, WEIGHED, TURN_BACK, PUSH_S = 36, 5, 7, 22, 0.8
ROUND_M, SPEEDS_M_S, SAFE_M, HASTE, DRAG, GROWTH = 1.6, (3.0, 3.0, 2.0), 3.4, 7.5, 1.3, 5
SEEN = [*(position("object_1", axis) for axis in (0, 1)), *(velocity("object_1", axis) for axis in (0, 1))]
POINTS, STEPS = 6, 8
SIGMA = np.array([0.0075, 0.0075, 0.0095, 0.0095])
PRICE, STARTS, TRIED, ROUNDS, POLISHED = 4.0, 150, 4, 12, 4


def _counted(structure, knobs, turnings, interval):
    """Counts at the ends of intervals in which the puck turns by angles round the post; intervals come first."""
    if structure == "fades":
        count, counts = 0.0, []
        kept = np.exp(-interval / knobs["lapse"])
        for turning in turnings:
            count = count * kept + turning * np.sqrt(kept)
            counts.append(count)
        return np.array(counts)
    sense = {"winds": 0, "left": 1, "right": -1}[structure]
    return np.cumsum(np.maximum(0.0, sense * turnings) if sense else turnings, axis=0)


def _turning(knobs, x, y, vx, vy):
    """Angular velocity round the post."""
    dx, dy = x - knobs["middle_x"], y - knobs["middle_y"]
    return (dx * vy - dy * vx) / (dx**2 + dy**2 + CORE_M**2)


def _drawn(knobs, x, y, count):
    """Force of the post per kilogram at a place after a count."""
    dx, dy = x - knobs["middle_x"], y - knobs["middle_y"]
    r = np.sqrt(dx**2 + dy**2 + CORE_M**2)
    beyond = np.abs(count) - knobs["slack"]
    wound = 0.5 * (beyond + np.sqrt(beyond**2 + BLUR**2))
    size = (knobs["pull"] * (r / SCALE_M) ** knobs["n"] + knobs["k"] * wound) / r
    return -size * dx, -size * dy


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the count."""
    x, y, vx, vy, count = state
    fx, fy = _drawn(knobs, x, y, count)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    turning = _turning(knobs, x, y, vx, vy)
    if structure == "fades":
        turning = turning - count / knobs["lapse"]
    if structure in ("left", "right"):
        turning = np.maximum(0.0, turning if structure == "left" else -turning)
    m = knobs["m"]
    return np.array([vx, vy, force[0] / m + fx - drag * vx, force[1] / m + fy - drag * vy, turning])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0, 0.0),
    sigma=(0.003, 0.003, 0.008, 0.008),
    longest_s=PUSH_S / STEPS,
)


def predict(structure, knobs):
    """Holding forces after rounds along squares in either sense; resistance to a fast motion."""
    first, second = (_held(structure, knobs, *square) for square in SQUARES)
    return [first[0], second[1], float(knobs["m"] * knobs["c"] * FAST_M_S ** knobs["p"])]


def _corners(half, speed, sense):
    """Start, and velocity of each of eight half sides, of a round along a square."""
    ways = [(0, 1), (-1, 0), (-1, 0), (0, -1), (0, -1), (1, 0), (1, 0), (0, 1)]
    start = np.array([half, 0.0])
    if sense < 0:
        start, ways = start[::-1], [(y, x) for x, y in ways]
    return start, speed * np.array(ways, dtype=float)


def _held(structure, knobs, half, speed, rounds, sense):
    """Force of the hand that holds the puck after rounds along a square."""
    place, velocities = _corners(half, speed, sense)
    lasting, turnings, parts = half / speed, [], 40
    interval = lasting / parts
    for vx, vy in velocities:
        times = (np.arange(parts) + 0.5) * interval
        turnings.append(interval * _turning(knobs, place[0] + vx * times, place[1] + vy * times, vx, vy))
        place = place + lasting * np.array([vx, vy])
    count = _counted(structure, knobs, np.tile(np.concatenate(turnings), rounds), interval)[-1]
    return [float(-knobs["m"] * part) for part in _drawn(knobs, *place, count)]


def measure(engine, knobs):
    """The same in the engine, with a puck too heavy to be stopped."""
    held = []
    for half, speed, rounds, sense in SQUARES:
        heavy = engine.changed({f"joint[object_1_{axis}].armature": HEAVY_KG for axis in "xy"})
        heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
        place, velocities = _corners(half, speed, sense)
        for way in np.tile(velocities, (rounds, 1)):
            heavy.place("object_1", np.array([*place, 0.05]), {})
            heavy.set_velocity("object_1", np.array([*way, 0.0]))
            heavy.step(heavy.whole_steps(half / speed))
            place = place + way * half / speed
        heavy.set_velocity("object_1", np.zeros(3))
        heavy.step(1)
        held.append(-heavy.twist("object_1").linear * HEAVY_KG / heavy.timestep)
    fast = force_on_puck(engine, (0.0, 0.0)) - force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))
    return [float(held[0][0]), float(held[1][1]), float(fast[0])]


def naive(knobs):
    """Nothing is counted; the pull of the post falls with the square of the distance."""
    first, second, resisting = predict(knobs["kind"], knobs)
    m = knobs["m"]
    return {
        "no past": [
            float(-m * _drawn(knobs, SQUARES[0][0], 0.0, 0.0)[0]),
            float(-m * _drawn(knobs, 0.0, SQUARES[1][0], 0.0)[1]),
            resisting,
        ],
        "linear drag": [first, second, float(m * knobs["c"] * FAST_M_S)],
    }


def stage(task):
    """Lead it as fast; else push and look."""
    yield [call("apply_force", object_id="object_1", force_vector=[500, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([10 / max(speed, 0.01), 10 / max(speed, 0.01), 40 / max(speed, 0.01)])]


def _path(course):
    """Places and velocities at even intervals within each push, by cubic curves through the readings, and the times."""
    before = np.vstack([np.zeros(4), course.readings[:-1]])[:, None, :]
    after, h = course.readings[:, None, :], course.durations[:, None, None]
    s = ((np.arange(POINTS) + 0.5) / POINTS)[None, :, None]
    x0, v0, x1, v1 = before[..., :2], before[..., 2:] * h, after[..., :2], after[..., 2:] * h
    bend, twist = 3 * (x1 - x0) - 2 * v0 - v1, 2 * (x0 - x1) + v0 + v1
    places = x0 + s * (v0 + s * (bend + s * twist))
    velocities = (v0 + s * (2 * bend + 3 * s * twist)) / h
    return np.concatenate([places, velocities], axis=2)


def _knobs(structure, units):
    """Constants at points of the unit cube."""
    spans = ((name, *BOX[name], unit) for name, unit in zip(STRUCTURES[structure], units, strict=True))
    return {
        name: low * (high / low) ** unit if low > 0 else low + (high - low) * unit for name, low, high, unit in spans
    }


def _misfits(course, path, structure, units):
    """Misfits in standard deviations, each push begun from the readings before it; a column for each trial."""
    knobs, trials = _knobs(structure, units), units.shape[1]
    x, y, vx, vy = path.transpose(2, 0, 1).reshape(4, -1, 1)
    interval = course.durations[0] / POINTS
    counts = _counted(structure, knobs, interval * _turning(knobs, x, y, vx, vy), interval)
    before = np.vstack([np.zeros((1, trials)), counts[POINTS - 1 :: POINTS][:-1]])
    readings = np.vstack([np.zeros(4), course.readings[:-1]]).T[:, :, None] + np.zeros(trials)
    with np.errstate(all="ignore"):
        state = np.concatenate([readings, before[None]])
        ends = LAWS.advanced(structure, knobs, 0.0, state, course.durations[:, None], course.controls.T[:, :, None])
        misfit = (ends[:4] - course.readings.T[:, :, None]) / SIGMA[:, None, None]
    misfit = np.clip(np.nan_to_num(misfit, nan=1e4), -1e4, 1e4).reshape(-1, trials)
    return np.vstack([misfit, 0.3 * (units - 0.5)])


def _whole(course, structure, units):
    """Misfits in standard deviations for the course from its start; a column for each trial."""
    knobs, trials = _knobs(structure, units), units.shape[1]
    state, misfit = np.zeros((5, trials)), []
    with np.errstate(all="ignore"):
        for duration, control, reading in zip(course.durations, course.controls, course.readings, strict=True):
            state = LAWS.advanced(structure, knobs, 0.0, state, duration, control[:, None] + np.zeros(trials))
            misfit.append((state[:4] - reading[:, None]) / np.array(LAWS.sigma)[:, None])
    misfit = np.clip(np.nan_to_num(np.concatenate(misfit), nan=1e4), -1e4, 1e4)
    return np.vstack([misfit, 0.3 * (units - 0.5)])


def _mass(readings):
    """Mass by the first pushes, before the puck goes round evenly."""
    return FLOOR.mass(readings[: 8 * WEIGHED])


def _fitted(readings, structure, *, polished=False):
    """Chi-square and constants of the best fit of a structure to the pushes; `polished` by the course as a whole."""
    course = recorded(readings, [force("object_1", axis) for axis in (0, 1)], SEEN)
    path = _path(course)

    def misfits(units):
        return _misfits(course, path, structure, units)

    starts = np.random.default_rng(0).random((len(STRUCTURES[structure]), STARTS))
    near = np.log(_mass(readings) / BOX["m"][0]) / np.log(BOX["m"][1] / BOX["m"][0])
    starts[0] = near + 0.06 * (starts[0] - 0.5)
    order = np.argsort(np.log1p(misfits(starts) ** 2).sum(axis=0))[:TRIED]
    found = [refined(misfits, starts[:, start], ROUNDS) for start in order]
    costs = [float((misfits(unit[:, None]) ** 2).sum()) for unit in found]
    unit = found[int(np.argmin(costs))]
    if polished:
        unit = refined(lambda units: _whole(course, structure, units), unit, POLISHED)
    knobs = _knobs(structure, unit)
    return min(costs), {name: float(value) for name, value in knobs.items()}


def fit(readings, structure):
    """Predictions of the best fit of a structure."""
    return predict(structure, _fitted(readings, structure, polished=True)[1])


def _best(readings):
    """Predictions of the structure that fits best, each constant paid for."""
    costs = {name: _fitted(readings, name)[0] + PRICE * len(names) for name, names in STRUCTURES.items()}
    return fit(readings, min(costs, key=lambda name: costs[name]))


def _coasted(place, speed, pushes, seconds):
    """Place and velocity after pushes per kilogram that are held against a drag in proportion to the speed."""
    kept = np.exp(-DRAG * seconds)
    after = speed * kept + pushes * (1 - kept) / DRAG
    return place + (speed - after + pushes * seconds) / DRAG, after


def _towards(place):
    """Directions away from a middle and round it, anticlockwise, at a place relative to it."""
    out = place / max(float(np.hypot(*place)), 0.3)
    return out, np.array([-out[1], out[0]])


def _aimed(place, speed, pull, middle, quick):
    """Push per kilogram that leads the puck on a round, where something pulls besides; place and velocity after it."""
    angles = np.linspace(0, 2 * np.pi, 37)[:-1]
    ways = np.concatenate([size * np.array([np.cos(angles), np.sin(angles)]).T for size in np.linspace(0, HASTE, 15)])
    out, round_ = _towards(place - middle)
    other = pull[0] * out + pull[1] * round_
    ends, after = _coasted(place, speed, ways + other, PUSH_S)
    midway, _ = _coasted(place, speed, ways + other, PUSH_S / 2)
    around = ends - middle
    r = np.hypot(*around.T)
    wanted = quick * np.array([-around[:, 1], around[:, 0]]).T / np.maximum(r, 0.3)[:, None]
    beyond = np.maximum(np.hypot(*ends.T) - SAFE_M, 0) + np.maximum(np.hypot(*midway.T) - SAFE_M, 0)
    best = int(np.argmin((r - ROUND_M) ** 2 + 0.5 * ((after - wanted) ** 2).sum(axis=1) + 20 * beyond))
    return ways[best], ends[best], after[best]


def _pulled(place, speed, push, after):
    """What else pulled per kilogram during a push, away from a middle and round it, at a place relative to it."""
    kept = np.exp(-DRAG * PUSH_S)
    other = (after - speed * kept) * DRAG / (1 - kept) - push
    return np.clip([other @ part for part in _towards(place)], -4.0, 4.0)


def solve(task):
    """Begin gently, lead the puck round and round in one sense, then in the other, and fit every law of the count."""
    seen, place, speed, pull, middle, mass = [], np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), FLOOR.lightest_kg
    for turn in range(PUSHES // 2):
        quick = SPEEDS_M_S[turn % 3] * (1 if 2 * turn < TURN_BACK else -1)
        first, midway, fast = _aimed(place, speed, pull, middle, quick)
        second, _, _ = _aimed(midway, fast, pull, middle, quick)
        calls = [*FLOOR.push(mass * first, PUSH_S), *FLOOR.push(mass * second, PUSH_S)]
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        known = min(_mass(seen), GROWTH * mass) if turn else mass  # nothing is pushed in the first turn
        midway, fast = (np.array(readings[at][field][:2]) for at, field in ((2, "position"), (3, "velocity")))
        place, speed = (np.array(readings[at][field][:2]) for at, field in ((6, "position"), (7, "velocity")))
        if len(seen) == 8 * LEARNT:
            middle = np.array([_fitted(seen, "winds")[1][name] for name in ("middle_x", "middle_y")])
        pull = _pulled(midway - middle, fast, second * mass / known, speed)
        mass = known
    yield [answer(_best(seen))]


def batch(task):
    """Greater and greater pushes, each time round and round, and the same fit."""
    calls = [asked for fx, fy in BATCH for asked in FLOOR.push(np.array([fx, fy]), PUSH_S)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=(),
    near_m=0.0,
    safe_m=SAFE_M,
    haste=HASTE,
    leg_s=PUSH_S,
    slowed=0.0,
    coasts_s=0.0,
    fixed_pushes=(),
    looks=1,
    lightest_kg=0.05,
    heaviest_kg=20.0,
)
BATCH = [
    (size * np.cos(turned), size * np.sin(turned))
    for size, turned in zip(0.3 * 1.5 ** np.arange(15), 1.1 * np.arange(15), strict=True)
]
