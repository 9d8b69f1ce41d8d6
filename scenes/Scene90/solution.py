"""Scene 90: weigh the carts; then each experiment is the one that the fits so far expect to tell most."""

from itertools import product
from math import sqrt

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

CARTS = ("object_1", "object_2")
REDUCED = 2 / 3
"""Of both carts, in masses of object_1; opposed forces leave their centre of mass where it is."""
SHARE = 1.5
"""Change of the distance per way of object_1."""
NOISE = 0.0121
"""Of the change of the distance: noise and rounding of one reading, m."""
LIMIT_N, NEAR_M, CAUGHT_M = 59.9, 0.6, 0.75
RATE, DRIVE_N, WAIT_S = 10.0, 12.0, 40.0
WEIGH_N, WEIGH_S, WEIGH_LOOKS, LOOK_S = 27.0, 0.7, 5, 0.05
"""Push that weighs the carts: to and fro, then looks at where they stand."""
PARTS = {"series": 2, "series_and_wheel": 3, "wheel_and_spring": 3}
GRID = [(5, 20, 80, 300), (0.5, 1.5, 5, 15), (0.4, 1.2, 4.0)]
LOW, HIGH = np.log([1.0, 0.1, 0.05]), np.log([3000.0, 500.0, 30.0])
FIRST = [(1.0, 0.04)] * 3 + [(-1.0, 0.04)] * 3 + [(0.0, 0.1)] * 3
SPACINGS = (0.04, 0.1, 0.2, 0.5, 1.0)
SHAPES = (
    (1, 1, 1, 1, 0, 0, 0, 0),
    (1, 1, 1, 1, -1, -1, -1, -1),
    (1,) * 8,
    (1, 1, -1, -1, 1, 1, -1, -1),
    (1, 1, -1, -1),
    (1, 1, 0, 0),
)
PULSES = [(force, 0.12) for force in (1.5, 1.5, -1.5, -1.5, 0.0)]
PULSES += [(force, 0.2) for force in (10.0, 10.0, -10.0, -10.0, 0.0)]
PULSES += [(40.0, 0.3), (-40.0, 0.3)]
"""Of the fixed batch: forces in N, and times."""
LEAST_WHEEL = 0.4
"""Least force of a flywheel per acceleration, over the mass of object_1, that the task allows."""
START_M = 0.05
"""Range of the error of the place from which the ways are counted, m."""
STARTS = 12
"""Number of points of the grid from which a net is fitted in the end."""
CALLS, TIME_S = 150, 26.0
PENALTY = 4.0


def _poles(structure, values, mass):
    """Rates, and weights in the distance, of the free motions after a step of force on this mass."""
    k, c, b = (*values, 0.0)[:3]
    if structure == "wheel_and_spring":
        matrix = [[0, 1, 0, 0], [0, -c / mass, 0, c / mass], [0, 0, 0, 1], [0, c / b, -k / b, -c / b]]
        push = [0, 1 / mass, 0, 0]
    else:
        mass = mass + b
        matrix, push = [[0, 1, 0], [-k / mass, 0, k / mass], [k / c, 0, -k / c]], [0, 1 / mass, 0]
    rates, vectors = np.linalg.eig(np.array(matrix, dtype=float))
    return rates, vectors[0] * np.linalg.solve(vectors, np.array(push, dtype=complex))


def _step_response(poles, times):
    """Change of the distance after a force of 1 N has acted for these times; 0 before."""
    rates, weights = poles
    t = np.maximum(times, 0.0)[..., None]
    still = np.abs(rates) < 1e-7
    safe = np.where(still, 1.0, rates)
    return np.real(np.where(still, t, np.expm1(safe * t) / safe) @ weights)


def _ways(structure, values, segments, before=()):
    """Changes of the distance at the ends of segments (force, duration), from rest, after the segments before."""
    return _answered(_poles(structure, values, REDUCED), [*before, *segments])[len(before) :]


def _answered(poles, segments):
    forces = np.array([force for force, _ in segments])
    ends = np.cumsum([duration for _, duration in segments])
    jumps = np.diff(forces, prepend=0.0)
    kept = jumps != 0
    starts = (ends - [duration for _, duration in segments])[kept]
    return _step_response(poles, ends[:, None] - starts) @ jumps[kept]


def _predict(structure, values, mass):
    """Amplitude of object_1 under the drive, and its way under the steady force, with object_2 nailed."""
    k, c, b = (*values, 0.0)[:3]
    dash, wheel = 1j * RATE * c, -b * RATE**2
    spring, outside = (k + wheel, 0.0) if structure == "wheel_and_spring" else (k, wheel)
    box = outside + spring * dash / (spring + dash)
    way = _step_response(_poles(structure, values, 1.0), np.array(WAIT_S))
    return [float(DRIVE_N / mass / abs(box - RATE**2)), float(DRIVE_N / mass * way)]


def _fitted(structure, segments, ways, start=None, tried=2):
    """Chi² and logarithms of the parts' values, by least squares from the best of a grid."""
    count = PARTS[structure]

    def off(logs):
        errors = (_ways(structure, np.exp(logs), segments) - ways) / NOISE
        return errors - errors.mean()

    grid = [np.log(point) for point in product(*GRID[:count])]
    starts = sorted(grid, key=lambda logs: float(np.sum(np.square(off(logs)))))[: tried if start is None else 1]
    starts += [] if start is None else [start]
    bounds = (LOW[:count], HIGH[:count])
    fits = [least_squares(off, np.clip(logs, *bounds), bounds=bounds, max_nfev=15) for logs in starts]
    best = min(fits, key=lambda got: got.cost)
    return 2 * best.cost, best.x


def _fits(segments, ways, before):
    """Structure → chi² with a penalty for each part, and logarithms of values."""
    found = {}
    for structure, count in PARTS.items():
        chi, logs = _fitted(structure, segments, ways, before[structure][1] if before else None)
        found[structure] = (chi + PENALTY * count, logs)
    return found


def _slopes(function, logs):
    """Derivatives of a vector by the logarithms."""
    return np.column_stack([(function(logs + d) - function(logs - d)) / 2e-4 for d in 1e-4 * np.eye(len(logs))])


def _information(structure, logs, segments):
    slopes = _slopes(lambda at: _ways(structure, np.exp(at), segments), logs) / NOISE
    return slopes.T @ slopes + 0.3 * np.eye(len(logs))


def _suspects(found, segments, ways):
    """Values that the readings allow: of each structure not yet excluded, of its uncertain neighbours, of the grid."""
    best = min(chi for chi, _ in found.values())
    suspects = [
        (structure, values)
        for structure, count in PARTS.items()
        for values in product(*GRID[:count])
        if np.sum(np.square(_ways(structure, values, segments) - ways)) / NOISE**2 < best + 20
    ]
    for structure, (chi, logs) in found.items():
        if chi > best + 25:
            continue
        scale, axes = np.linalg.eigh(_information(structure, logs, segments))
        for width, axis in zip(np.minimum(2.5 / np.sqrt(scale), 2.0), axes.T, strict=True):
            suspects += [(structure, np.exp(logs + sign * width * axis)) for sign in (-1, 0, 1)]
    return suspects


def _designs(found, segments, ways, calls_left, mass):
    """Possible next experiments within the limits, each as strong as no suspect makes it dangerous."""
    suspects = [_poles(*suspect, REDUCED) for suspect in _suspects(found, segments, ways)]
    time_left = TIME_S - 2 * WEIGH_S - sum(duration for _, duration in segments)
    for spacing in SPACINGS:
        coast = [(0.0, spacing)] * 8 + [(0.0, spacing + 0.3 * 1.6**turn) for turn in range(7)]
        fading = [_answered(poles, [*segments, *coast])[len(segments) :] for poles in suspects]
        for shape in SHAPES:
            test = [(float(part), spacing) for part in shape]
            if spacing * len(shape) > time_left or len(_calls(test, None, 1.0)) > calls_left:
                continue
            padded = [*test, *coast[len(test) :]]
            new = [_answered(poles, padded) for poles in suspects]
            for sign in (1, -1):
                room = NEAR_M - np.sign(sign * np.array(new)) * np.array(fading)
                strength = min(LIMIT_N / mass, float(np.min(room / np.maximum(np.abs(new), 1e-9))))
                if strength > 0.05:
                    yield [(round(sign * strength * part, 3), spacing) for part, _ in test]


def _next(found, segments, ways, calls_left, mass):
    """The experiment after which the answer is expected to be least uncertain, with the two best structures in mind."""
    ranked = sorted(found.items(), key=lambda item: item[1][0])
    (structure, (best, logs)), (other, (second, other_logs)) = ranked[:2]
    known = _information(structure, logs, segments)
    asked = _slopes(lambda at: np.log(_predict(structure, np.exp(at), 1.0)), logs)
    chosen, least = None, np.inf
    for design in _designs(found, segments, ways, calls_left, mass):
        slopes = _slopes(lambda at, new=design: _ways(structure, np.exp(at), new, segments), logs) / NOISE
        errors = np.einsum("ij,jk,ik->i", asked, np.linalg.inv(known + slopes.T @ slopes), asked)
        rival = _ways(other, np.exp(other_logs), design, segments)
        apart = (_ways(structure, np.exp(logs), design, segments) - rival) / NOISE
        doubt = 3.0 / (1.0 + max(second - best, 0.0) + 0.3 * float(apart @ apart))
        score = sqrt(float(np.max(errors))) + doubt
        if score < least:
            chosen, least = design, score
    return chosen


def _push(force, other):
    return [
        call("apply_force", object_id=cart, force_vector=[wanted, 0, 0])
        for cart, wanted in zip(CARTS, (force, other), strict=True)
    ]


def _weighing():
    """Both carts pushed to and fro so that their distance stays; then looks at where they stand."""
    calls = [*_push(WEIGH_N, 2 * WEIGH_N), call("step", duration=WEIGH_S)]
    calls += [*_push(-WEIGH_N, -2 * WEIGH_N), call("step", duration=WEIGH_S), *_push(0.0, 0.0)]
    return calls + [call("step", duration=LOOK_S), call("get_position", object_id=CARTS[0])] * WEIGH_LOOKS


def _weighed(places):
    """Mass of object_1, and where the carts stand, from the places after the weighing."""
    start = float(np.mean(places[:WEIGH_LOOKS]))
    return WEIGH_N * WEIGH_S**2 / start, start


def _calls(segments, force, mass):
    """Opposed forces on the carts, set where they change; object_1 read after each segment."""
    calls = []
    for wanted, duration in segments:
        if wanted != force:
            calls += _push(wanted * mass, -wanted * mass)
            force = wanted
        calls += [call("step", duration=duration), call("get_position", object_id=CARTS[0])]
    return calls


def solve(task):
    """The weighing, a gentle first push, then in each round the experiment that promises most, until a catch."""
    calls, force, design, found = _weighing(), 0.0, FIRST, None
    seen = list(zip(calls, (yield calls), strict=True))
    mass, segments, ways = _record(seen)
    while design:
        calls, before = _calls(design, force, mass), len(ways)
        seen += zip(calls, (yield calls), strict=True)
        mass, segments, ways = _record(seen)
        found = _fits(segments, ways, found)
        caught = len(ways) < before + len(design)
        force, design = design[-1][0], None if caught else _next(found, segments, ways, CALLS - len(seen), mass)
    structure = min(found, key=lambda name: found[name][0])
    yield [answer(_predict(structure, np.exp(found[structure][1]), mass))]


def structure(knobs):
    """How the parts in the box are joined."""
    return knobs["net"]


def fit(readings, structure):
    """The answer by the net of this name, fitted to the readings."""
    mass, segments, ways = _record(readings)
    return _predict(structure, np.exp(_fitted(structure, segments, ways)[1]), mass)


def _record(readings):
    """Mass of object_1, forces over it with their durations, and changes of the distance, up to a catch."""
    segments, places, force = [], [], 0.0
    for asked, reading in readings:
        if asked.tool == "apply_force" and asked.arguments["object_id"] == CARTS[0]:
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            segments.append((force, asked.arguments["duration"]))
        elif asked.tool == "get_position":
            places.append(reading["position"][0])
    mass, start = _weighed(places)
    ways = SHARE * (np.array(places) - start)
    caught = np.abs(ways) > CAUGHT_M
    end = int(np.argmax(caught)) if caught.any() else len(ways)
    return mass, [(force / mass, duration) for force, duration in segments[-len(ways) :]][:end], ways[:end]


def rivals(readings):
    """Every net, fitted; one constant more is the error of the place from which the ways are counted."""
    mass, segments, ways = _record(readings)
    return {structure: _member(structure, mass, segments, ways) for structure in PARTS}


def _member(structure, mass, segments, ways):
    """A net, fitted to the changes of the distance."""
    count = PARTS[structure]

    def misfits(constants):
        return (_ways(structure, np.exp(constants[:count]), segments) + constants[count] - ways) / NOISE

    low = np.append(LOW[:count], -START_M)
    low[2:count] = np.log(LEAST_WHEEL)
    high = np.append(HIGH[:count], START_M)
    start = np.append(_fitted(structure, segments, ways, tried=STARTS)[1], 0.0)
    best = least_squares(misfits, np.clip(start, low, high), bounds=(low, high), x_scale=high - low).x
    ranges = list(zip(low, high, strict=True))
    return member(misfits, lambda found: _predict(structure, np.exp(found[:count]), mass), best, ranges)


def batch(task):
    """The weighing, and ever stronger opposed pushes, all laid down beforehand; the best of the nets."""
    calls = _weighing() + _calls(PULSES, 0.0, 1.0)
    mass, segments, ways = _record(list(zip(calls, (yield calls), strict=True)))
    found = _fits(segments, ways, None)
    structure = min(found, key=lambda name: found[name][0])
    yield [answer(_predict(structure, np.exp(found[structure][1]), mass))]


def stage(task):
    """Push object_1 as asked, though object_2 is free; for the drive, take the cart alone."""
    readings = yield [
        *_push(DRIVE_N, 0.0),
        call("step", duration=TIME_S),
        call("get_position", object_id=CARTS[0]),
        call("step", duration=WAIT_S - TIME_S),
    ]
    way = readings[3]["position"][0] * WAIT_S / TIME_S
    yield [answer([DRIVE_N / RATE**2, way])]


def _values(knobs):
    return tuple(knobs[name] for name in ("k", "c", "b")[: PARTS[knobs["net"]]])


def theory(knobs):
    """From the stiffness of the net at the rate of the drive, and its free motions."""
    return _predict(knobs["net"], _values(knobs), knobs["m"])


def naive(knobs):
    """Spring and dashpot side by side; the cart without the box; a flywheel taken for mass of the cart."""
    k, c, b = knobs["k"], knobs["c"], knobs["b"]
    heavy = 1.0 + (b if PARTS[knobs["net"]] > 2 else 0.0)
    found = {
        "side by side": (abs(k + 1j * RATE * c - RATE**2), 1 / k),
        "no box": (RATE**2, WAIT_S / c),
        "heavier cart on a dashpot": (abs(1j * RATE * c - heavy * RATE**2), WAIT_S / c),
    }
    drive = DRIVE_N / knobs["m"]
    return {name: [drive / stiffness, drive * way] for name, (stiffness, way) in found.items()}


def _apart(world):
    """Change of the distance."""
    return float(world.pose(CARTS[0]).position[0] - world.pose(CARTS[1]).position[0] + 1.0)


def measure(engine, knobs):
    """Both drives in the engine, with object_2 too heavy to move and the hooks taken away."""
    changes = {"body[object_2]/inertial.mass": 1e8, "body[hooks].pos": (0.0, 0.0, 5.0)}
    world = engine.changed(changes)
    world.push(CARTS[0], force=np.array([DRIVE_N, 0.0, 0.0]))
    world.step(world.whole_steps(WAIT_S))
    way = _apart(world)
    world, rows = engine.changed(changes), []
    steps, last = world.whole_steps(WAIT_S), world.whole_steps(20 * np.pi / RATE)
    for turn in range(steps):
        time = (turn + 0.5) * world.timestep
        world.push(CARTS[0], force=np.array([DRIVE_N * np.cos(RATE * time), 0.0, 0.0]))
        world.step(1)
        if turn >= steps - last:
            rows.append((RATE * (turn + 1) * world.timestep, _apart(world)))
    phase, places = np.array(rows).T
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones(len(phase)), phase])
    parts = np.linalg.lstsq(basis, places, rcond=None)[0]
    return [float(np.hypot(parts[0], parts[1])), way]
