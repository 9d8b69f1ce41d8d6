"""Scene 105: stretch the three threads together; the first to reach its strength decides what the others carry."""

from itertools import pairwise, permutations
from math import pi

import numpy as np
from scipy.optimize import least_squares

from scenes.courses import accepted
from scenes.family import member
from scenes.protocol import answer, call

GRAVITY = 9.81
TOP = 3.0
PANS = (1, 2, 3)
STRENGTH = {1: 25.0, 2: 30.0, 3: 35.0}
NUMBER = {1: 1, 2: 3, 3: 1}
"""How many threads of each sort bear the beam."""
WAIT_S = 12.0
ROUNDS = 16
NEAR = 0.96
"""Share of its strength to which a thread is loaded at most."""
MADE_N = 5.6 * GRAVITY
"""Weight of all balls that can be made."""
DENSITY = 1e4
RESOLUTION = 1e-3
KINDS = {
    "stiffer": (1, False),
    "weaker": (-1, False),
    "slack, then stiffer": (1, True),
    "slack, then weaker": (-1, True),
}
"""Whether the stiffness rises or falls at the bend, and whether a thread is slack at first."""
STIFFNESS, BEND, RATIO, SLACK = (25, 1800), (0.55, 0.88), (2.5, 5), (0.01, 0.2)
"""As the task bounds them: N/m, share of the strength, ratio of the two stiffnesses, m."""
BENDS = np.linspace(0.57, 0.87, 13)


def _lines(points):
    """Two straight lines through the points, each as slope and tension at 0; twice the same if one is enough."""
    x, force = np.array(points).T

    def line(part):
        if np.ptp(x[part]) < 1e-3:
            return np.array([force[part][-1] / max(x[part][-1], 1e-3), 0.0]), 0.0
        found = np.polyfit(x[part], force[part], 1)
        return found, float(np.sum(((np.polyval(found, x[part]) - force[part]) / max(found[0], 1.0)) ** 2))

    whole, misfit = line(slice(None))
    best = (misfit - 8 * RESOLUTION**2, (whole, whole))
    for split in range(2, len(x) - 1):
        (first, left), (second, right) = line(slice(None, split)), line(slice(split, None))
        if left + right < best[0]:
            best = (left + right, (first, second))
    return best[1]


def _reach(points, strength):
    """Extension at which a thread breaks, by its last line."""
    slope, start = _lines(points)[1]
    return (strength - start) / max(slope, 1.0)


def _ranges(kind):
    """Least and greatest stiffness, share of the strength at the bend, ratio of stiffnesses, and slack length."""
    logs = [tuple(np.log(STIFFNESS)), BEND, tuple(np.log(RATIO))]
    return [*logs, tuple(np.log(SLACK))] if KINDS[kind][1] else logs


def _extension(kind, p, strength, tension):
    """Extension under a tension."""
    rising, slack = KINDS[kind]
    stiffness, bend = np.exp(p[0]), p[1] * strength
    onward = stiffness * np.exp(rising * p[2])
    start = np.exp(p[3]) if slack else 0.0
    return start + np.minimum(tension, bend) / stiffness + np.maximum(tension - bend, 0.0) / onward


def _tension(kind, p, strength, extension):
    """Tension at an extension: the inverse of `_extension`."""
    marks = np.array([0.0, p[1] * strength, strength])
    return float(np.interp(extension, _extension(kind, p, strength, marks), marks))


def _fitted(kind, points, strength):
    """Chi-square and constants of a thread as of a kind, and the misfits as a function of the constants."""
    ways, tensions = np.array(points).T
    low, high = np.array(_ranges(kind)).T
    rising = KINDS[kind][0]

    def off(p):
        return (_extension(kind, p, strength, tensions) - ways) / (RESOLUTION / 3)

    starts = []
    for bend in BENDS:
        for ratio in (2.7, 4.0):
            # For a given bend and ratio the extension is linear in the compliance and the slack length.
            kinked = np.minimum(tensions, bend * strength)
            kinked += np.maximum(tensions - bend * strength, 0.0) * ratio**-rising
            rows = np.column_stack([kinked, np.ones(len(ways))])[:, : 2 if KINDS[kind][1] else 1]
            found = np.maximum(np.linalg.lstsq(rows, ways, rcond=None)[0], 1e-4)
            starts.append([-np.log(found[0]), bend, np.log(ratio), *np.log(found[1:])])
    starts = [np.clip(start, low + 1e-4, high - 1e-4) for start in starts]
    starts.sort(key=lambda p: float(np.sum(off(p) ** 2)))
    fits = [least_squares(off, start, bounds=(low, high), x_scale=high - low) for start in starts[:4]]
    best = min(fits, key=lambda found: found.cost)
    return 2 * float(best.cost), best.x, off


def _total(kinds, constants):
    """The greatest load of the beam, from kind and constants of each thread."""
    threads = list(zip(PANS, kinds, constants, strict=True))
    end = min(_extension(kind, p, STRENGTH[pan], STRENGTH[pan]) for pan, kind, p in threads)
    return sum(NUMBER[pan] * _tension(kind, p, STRENGTH[pan], end) for pan, kind, p in threads) / GRAVITY


def _points_of(exchanges):
    """Extensions and tensions of each thread."""
    points, masses, tension = {pan: [] for pan in PANS}, {}, dict.fromkeys(PANS, 0.0)
    for asked, reading in accepted(exchanges):
        if asked.tool == "create_objects":
            masses[asked.arguments["name"]] = DENSITY * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            tension[int(asked.arguments["object2_id"][-1])] += GRAVITY * masses[asked.arguments["object1_id"]]
        elif asked.tool == "get_position":
            pan = int(asked.arguments["object_id"][-1])
            if tension[pan] > 0 and (not points[pan] or tension[pan] > points[pan][-1][1] + 1e-6):
                points[pan].append((TOP - reading["position"][2], tension[pan]))
    return points


def fit(readings, structure):
    """The greatest load, with the kinds of a structure."""
    points, kinds = _points_of(readings), structure.split("; ")
    return _total(kinds, [_fitted(kind, points[pan], STRENGTH[pan])[1] for pan, kind in zip(PANS, kinds, strict=True)])


def _sorts(exchanges):
    """Each thread fitted as of each kind."""
    points = _points_of(exchanges)
    return {(pan, kind): _fitted(kind, points[pan], STRENGTH[pan]) for pan in PANS for kind in KINDS}


def _hung(kinds, sorts):
    """The member of the family in which the threads are of these kinds."""
    threads = [sorts[pan, kind] for pan, kind in zip(PANS, kinds, strict=True)]
    places = np.cumsum([0, *(len(p) for _, p, _ in threads)])

    def each(constants):
        return [constants[start:end] for start, end in pairwise(places)]

    def misfits(constants):
        return np.concatenate([off(own) for (_, _, off), own in zip(threads, each(constants), strict=True)])

    best = np.concatenate([p for _, p, _ in threads])
    ranges = [edges for kind in kinds for edges in _ranges(kind)]
    return member(misfits, lambda constants: _total(kinds, each(constants)), best, ranges)


def rivals(readings):
    """Every choice of three kinds for the three sorts."""
    sorts = _sorts(readings)
    return {"; ".join(kinds): _hung(kinds, sorts) for kinds in permutations(KINDS, 3)}


def _guess(exchanges):
    """The greatest load, with the kinds that fit best."""
    sorts = _sorts(exchanges)
    best = min(
        permutations(KINDS, 3), key=lambda kinds: sum(sorts[choice][0] for choice in zip(PANS, kinds, strict=True))
    )
    return _total(best, [sorts[choice][1] for choice in zip(PANS, best, strict=True)])


def _add(pan, newtons, number, height):
    """Join a ball to a pan."""
    radius = (newtons / GRAVITY / DENSITY / (4 / 3 * pi)) ** (1 / 3)
    row, place = divmod(number, 4)
    where = [0.5 * (pan - 2) + 0.08 * place - 0.12, 0.08 * row - 0.16, height]
    name = f"b{pan}_{number}"
    made = call("create_objects", name=name, pos=where, density=DENSITY, rgba=[1, 0, 0, 1], radius=radius)
    return [made, call("attach_objects", object1_id=name, object2_id=f"object_{pan}")]


def solve(task):
    """Let the extensions grow together, and stop each thread at the least extension of breaking that is sure."""
    exchanges, goal = [], 0.04
    heights, tension = dict.fromkeys(PANS, TOP), dict.fromkeys(PANS, 0.0)
    active, points = list(PANS), {}
    for number in range(ROUNDS):
        calls = []
        last = min(active, key=lambda pan: TOP - heights[pan])
        for pan in active:
            part = 0.1 * STRENGTH[pan]
            if number > 1:
                slope, start = _lines(points[pan][-3:] if len(points[pan]) < 5 else points[pan])[1]
                part = min(slope * goal + start - tension[pan], 0.15 * STRENGTH[pan])
                if part < 0.025 * STRENGTH[pan] and pan != last:
                    continue  # It is ahead of the others: a ball on it would be wasted.
                part = max(part, 0.04 * STRENGTH[pan])
            if tension[pan] > 0.83 * STRENGTH[pan]:
                part = 0.033 * STRENGTH[pan]
            # A pan on a stiff thread swings under a new ball, beyond its rest by at most the way to it.
            part = min(part, NEAR * STRENGTH[pan] - tension[pan], (STRENGTH[pan] - tension[pan]) / 2)
            part = min(part, MADE_N - sum(tension.values()) - 1e-3)
            if part < 0.02:
                continue
            calls += _add(pan, part, number, heights[pan])
            tension[pan] += part
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=f"object_{pan}") for pan in active)]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        heights |= {pan: reading["position"][2] for pan, reading in zip(active, readings[-len(active) :], strict=True)}
        points = _points_of(exchanges)
        sure = [_reach(points[pan], STRENGTH[pan]) for pan in PANS if tension[pan] > 0.93 * STRENGTH[pan]]
        end = min(sure, default=9.0)
        active = [
            pan for pan in PANS if TOP - heights[pan] < 1.01 * end and tension[pan] < (NEAR - 0.01) * STRENGTH[pan]
        ]
        if not active:
            break
        goal = min(1.2 * max(min(TOP - heights[pan] for pan in active), 0.02), 1.03 * end)
    yield [answer(_guess(exchanges))]


def stage(task):
    """Load every thread nearly to its strength, as far as balls can be made, and add what was on."""
    calls = []
    for number in range(1, 5):
        for pan in PANS:
            calls += _add(pan, 0.24 * STRENGTH[pan], number, TOP)
    yield [*calls, call("step", duration=30)]
    yield [answer(0.96 * sum(NUMBER[pan] * STRENGTH[pan] for pan in PANS) / GRAVITY)]


def batch(task):
    """Six loads on each thread, as far as balls can be made and closer where threads bend, and the best fit."""
    calls = []
    for number, share in enumerate((0.2, 0.14, 0.09, 0.06, 0.06, 0.055)):
        for pan in PANS:
            calls += _add(pan, share * STRENGTH[pan], number, TOP)
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=f"object_{pan}") for pan in PANS)]
    yield [answer(_guess(zip(calls, (yield calls), strict=True)))]


def structure(knobs):
    """The kinds of the three sorts."""
    return "; ".join(knobs["sorts"][:3])


def naive(knobs):
    """Five times the least strength; the sum of the strengths; straight lines up to the strengths."""
    ends = {pan: knobs["end"] / knobs[f"reach{pan}"] for pan in PANS}
    return {
        "five times the weakest": 5 * STRENGTH[1] / GRAVITY,
        "sum of the strengths": sum(NUMBER[pan] * STRENGTH[pan] for pan in PANS) / GRAVITY,
        "straight lines": sum(NUMBER[pan] * STRENGTH[pan] * ends[pan] for pan in PANS) / GRAVITY,
    }


def theory(knobs):
    """The tensions at the least extension of breaking."""
    return knobs["all"] / GRAVITY


def measure(engine, knobs):
    """The engine's tensions: what pulls on heavy pans that are put to one place and let go."""
    changes = {}
    for pan in PANS:
        changes |= {f"body[object_{pan}]/inertial.mass": 1e4, f"joint[object_{pan}_joint].damping": 0}
    engine = engine.changed(changes)
    start = engine.save()

    def tension(pan, depth):
        engine.restore(start)
        where = engine.pose(f"object_{pan}").position.copy()
        where[2] = TOP - depth
        engine.place(f"object_{pan}", where, {})
        engine.step(1)
        return float(engine.twist(f"object_{pan}").linear[2]) * 1e4 / engine.time

    ends = []
    for pan in PANS:
        low, high = 0.0, 1.0
        for _ in range(40):
            middle = (low + high) / 2
            deep = (low + high) / 2
            low, high = (
                (low, deep) if tension(pan, middle) == 0 and middle > 0.6 * knobs[f"reach{pan}"] else (deep, high)
            )
        ends.append(low)
    end = min(ends) * (1 - 1e-6)
    return sum(NUMBER[pan] * tension(pan, end) for pan in PANS) / GRAVITY
