"""Scene 33: push a magnet slowly to many distances from another, fit the law of repulsion, carry it on."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

ASKED, LATCH, STOP = 0.08, 0.2, 0.5
PLACE_ERROR = 0.0013
FIRST, RATIO, SEEN, PAD = 0.005, 2.5, 0.007, 0.02
"""The first push, the ratio of the next ones, the way that counts as seen, and the way within which the pad bears."""
WAIT_S, LOOK_S, GROWTH, AWAY = 5.5, 0.3, 1.13, 0.44
FARTHEST, CALLS = 0.47, 149
WAYS = (
    (0.45, 0.415, 0.383, 0.355, 0.33, 0.307, 0.286, 0.267, 0.25, 0.237),
    (0.45, 0.415, 0.383, 0.355, 0.33, 0.307, 0.286, 0.267, 0.25, 0.236, 0.225, 0.216),
)
"""The first and the other ways in, and out again: so near to one another that the magnet does not get too fast."""
LOOKS = {0.45: 3, 0.307: 3, 0.216: 3}
"""Readings at some of these distances."""
FREE = {"power": (1.0, 3.5), "deep": (0.07, 0.2), "screened": (0.1, 0.5)}
"""Range of the second constant of each structure: power, depth, length; the first is the repulsion at 0.2 m."""


def _shape(kind, second, d):
    """Logarithm of the repulsion at a distance over that at 0.2 m."""
    if kind == "power":
        return second * np.log(LATCH / d)
    if kind == "deep":
        return 2 * np.log((LATCH + second) / (d + second))
    return 2 * np.log(LATCH / d) + (LATCH - d) / second


def _points(readings):
    """Distances and pushes of rest, off the stop and before the latch."""
    push, points = 0.0, []
    for asked, got in readings:
        if asked.tool == "apply_force":
            push = -asked.arguments["force_vector"][0]
        elif asked.tool == "get_position":
            d = got["position"][0]
            if d < LATCH - 0.006:
                break
            if d < FARTHEST and push > 0:
                points.append((d, push))
    return np.array(points or [(0.4, 1.0), (0.3, 2.0)]).T


def _off(kind, constants, d, push):
    """Misfits of distances, in standard deviations."""
    first, second = constants
    slope = (_shape(kind, second, d * 1.001) - _shape(kind, second, d)) / (0.001 * d)
    return (first + _shape(kind, second, d) - np.log(push)) / (slope * PLACE_ERROR)


def _fitted(kind, readings):
    """Misfit, logarithm of the repulsion at 0.2 m, and second constant of the best fit."""
    (d, push), (low, high) = _points(readings), FREE[kind]
    bounds, fits = ((-20.0, low), (20.0, high)), []
    for share in (0.3, 0.6):
        second = low * (high / low) ** share
        first = float(np.mean(np.log(push) - _shape(kind, second, d)))
        start, scale = (first, second), (1.0, second)
        fits.append(least_squares(lambda p: _off(kind, p, d, push), start, bounds=bounds, x_scale=scale, max_nfev=60))
    best = min(fits, key=lambda found: found.cost)
    return 2 * best.cost, *best.x


def rivals(readings):
    """Every law of repulsion, fitted."""
    d, push = _points(readings)
    found = {}
    for kind, span in FREE.items():
        best = _fitted(kind, readings)[1:]
        found[kind] = member(
            lambda p, kind=kind: _off(kind, p, d, push),
            lambda p, kind=kind: _push(kind, *p, ASKED),
            best,
            ((best[0] - 3, best[0] + 3), span),
        )
    return found


def _best(readings):
    """The structure that fits best, and its constants."""
    fits = {kind: _fitted(kind, readings) for kind in FREE}
    kind = min(fits, key=lambda name: fits[name][0])
    return kind, *fits[kind][1:]


def _push(kind, first, second, d):
    """Repulsion at a distance."""
    return float(np.exp(first + _shape(kind, second, d)))


def _hold(push, looks=1):
    """Hold a push, and read where the magnet rests, several times: each reading has an error of its own."""
    calls = [call("apply_force", object_id="object_1", force_vector=[-float(f"{push:.6g}"), 0, 0])]
    for wait in (WAIT_S, *[LOOK_S] * (looks - 1)):
        calls += [call("step", duration=wait), call("get_position", object_id="object_1")]
    return calls


def solve(task):
    """Weak pushes against the pad for the scale, small steps off it; then nearer and away again by the law so far."""
    seen, push, far = [], FIRST / RATIO, 0.0
    while far < SEEN:
        push *= RATIO
        calls = _hold(push)
        seen += zip(calls, (yield calls), strict=True)
        far = STOP - seen[-1][1]["position"][0]
    # A reading that falls short would send the magnet beyond the pad so far that it gets too fast.
    push *= PAD / (far + 2 * PLACE_ERROR)
    while len(_points(seen)[0]) < 3 or np.min(_points(seen)[0]) > AWAY:
        calls = []
        for _ in range(3):
            calls += _hold(push)
            push *= GROWTH
        seen += zip(calls, (yield calls), strict=True)
    place, way, rounds = float(np.min(_points(seen)[0])), [], 0
    while len(seen) < CALLS:
        law, calls = _best(seen), []
        for _ in range(6):
            if not way:
                goals = WAYS[min(rounds, 1)]
                rounds += 1
                way = [d for d in goals if d < place - 0.01] + [*goals[-2::-1]]
            place = way.pop(0)
            looks = LOOKS.get(place, 1)
            if len(seen) + len(calls) + 1 + 2 * looks <= CALLS:
                calls += _hold(_push(*law, place), looks)
        if not calls:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_push(*_best(seen), ASKED))]


def fit(readings, structure):
    """The force by the law of a structure."""
    return _push(structure, *_fitted(structure, readings)[1:], ASKED)


def predict(structure, knobs):
    """The law at the distance that is asked."""
    return _push(*_true(structure, knobs), ASKED)


def _true(kind, knobs):
    """Kind, logarithm of the repulsion at 0.2 m, and second constant."""
    second = {"power": "power", "deep": "depth", "screened": "length"}[kind]
    return kind, float(np.log(knobs["scale"])), knobs[second]


def _free(engine, knobs, place, oil):
    """The engine without the latch, with the magnet at a place, in oil that slows it at this rate."""
    free = engine.changed({"body[gate]/inertial.mass": 1e12, "joint[guide].damping": oil * knobs["mass"]})
    free.place("object_1", np.array([place, 0.0, 0.5]), {})
    return free


def measure(engine, knobs):
    """The magnet in thicker oil, without the latch, held at the distance by a force that follows it."""
    scale, free = knobs["scale"], _free(engine, knobs, ASKED, 50)
    push, tick = 3 * scale, 1 / free.whole_steps(1.0)
    for _ in range(free.whole_steps(10.0)):
        off = float(free.pose("object_1").position[0]) - ASKED
        push += scale * 400 * tick * off
        free.push("object_1", force=np.array([-push - 40 * scale * off, 0.0, 0.0]))
        free.step(1)
    return push


def settles(engine, knobs, off):
    """Where the magnet comes to rest under the asked force."""
    free = _free(engine, knobs, ASKED * (1 + off), 2.2)
    free.push("object_1", force=np.array([-predict(knobs["kind"], knobs), 0.0, 0.0]))
    free.step(free.whole_steps(15.0))
    return float(free.pose("object_1").position[0]) / ASKED - 1


def naive(knobs):
    """Inverse square from the nearest place; the straight line between 0.4 m and 0.2 m."""
    law = _true(knobs["kind"], knobs)
    near, far = _push(*law, LATCH), _push(*law, 0.4)
    return {
        "inverse square": (LATCH / ASKED) ** 2 * near,
        "straight line": near + (near - far) / 0.2 * (LATCH - ASKED),
    }


def stage(task):
    """Push as hard as possible, and look where it stays."""
    readings = yield [*_hold(300.0), *_hold(250.0)]
    yield [answer(250.0 * (readings[2]["position"][0] / ASKED) ** 2)]


def batch(task):
    """Pushes in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(20) for asked in _hold(0.03 * 1.6**n)]
    readings = yield calls
    yield [answer(_push(*_best(list(zip(calls, readings, strict=True))), ASKED))]
