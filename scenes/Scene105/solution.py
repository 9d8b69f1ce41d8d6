"""Scene 105: stretch the three threads together; the first to reach its strength decides what the others carry."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
TOP = 3.0
PANS = (1, 2, 3)
STRENGTH = {1: 25.0, 2: 30.0, 3: 35.0}
NUMBER = {1: 1, 2: 2, 3: 1}
"""How many threads of each sort bear the beam."""
WAIT_S = 12.0
ROUNDS = 18
NEAR = 0.96
"""Share of its strength to which a thread is loaded at most."""
DENSITY = 1e4
RESOLUTION = 1e-3


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


def _tension(lines, extension):
    """Tension by two lines: the stiffer one counts beyond their crossing if it comes second, else before."""
    first, second = (float(np.polyval(line, extension)) for line in lines)
    return max(max(first, second) if lines[1][0] > lines[0][0] else min(first, second), 0.0)


def _reach(points, strength):
    """Extension at which a thread breaks, by its last line."""
    slope, start = _lines(points)[1]
    return (strength - start) / max(slope, 1.0)


def _total(points, first):
    """Greatest load of the beam if the sort of the given pan breaks first."""
    end = _reach(points[first], STRENGTH[first])
    tensions = {pan: _tension(_lines(points[pan]), end) for pan in PANS}
    tensions[first] = STRENGTH[first]
    return sum(NUMBER[pan] * tensions[pan] for pan in PANS) / GRAVITY


def _first(points):
    """The pan whose thread breaks first."""
    return min(PANS, key=lambda pan: _reach(points[pan], STRENGTH[pan]))


def _points_of(exchanges):
    """Extensions and tensions of each thread."""
    points, masses, tension = {pan: [] for pan in PANS}, {}, dict.fromkeys(PANS, 0.0)
    for asked, reading in exchanges:
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
    """The greatest load if a given thread breaks first."""
    return _total(_points_of(readings), int(structure[-1]))


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
        for pan in active:
            part = 0.1 * STRENGTH[pan]
            if number > 1:
                slope, start = _lines(points[pan][-3:] if len(points[pan]) < 5 else points[pan])[1]
                part = min(max(slope * goal + start - tension[pan], 0.04 * STRENGTH[pan]), 0.15 * STRENGTH[pan])
            if tension[pan] > 0.83 * STRENGTH[pan]:
                part = 0.033 * STRENGTH[pan]
            part = min(part, NEAR * STRENGTH[pan] - tension[pan])
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
        goal = min(1.3 * max(min(TOP - heights[pan] for pan in active), 0.02), 1.03 * end)
    yield [answer(_total(points, _first(points)))]


def stage(task):
    """Load every thread nearly to its strength, as far as balls can be made, and add what was on."""
    calls = []
    for number in range(1, 5):
        for pan in PANS:
            calls += _add(pan, 0.24 * STRENGTH[pan], number, TOP)
    yield [*calls, call("step", duration=30)]
    yield [answer(0.96 * sum(NUMBER[pan] * STRENGTH[pan] for pan in PANS) / GRAVITY)]


def batch(task):
    """Six even loads on each thread, as far as balls can be made, and the best fit."""
    calls = []
    for number in range(6):
        for pan in PANS:
            calls += _add(pan, 0.118 * STRENGTH[pan], number, TOP)
        calls += [call("step", duration=WAIT_S), *(call("get_position", object_id=f"object_{pan}") for pan in PANS)]
    readings = yield calls
    points = _points_of(list(zip(calls, readings, strict=True)))
    yield [answer(_total(points, _first(points)))]


def structure(knobs):
    """Which thread breaks first."""
    return f"object_{min(PANS, key=lambda pan: knobs[f'reach{pan}'])}"


def naive(knobs):
    """Four times the least strength; the sum of the strengths; straight lines up to the strengths."""
    ends = {pan: knobs["end"] / knobs[f"reach{pan}"] for pan in PANS}
    return {
        "four times the weakest": 4 * STRENGTH[1] / GRAVITY,
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
