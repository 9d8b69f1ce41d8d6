"""Scene 33: push a magnet to many chosen distances from another, fit the law of repulsion, carry it on."""

import numpy as np
from scipy.optimize import least_squares

from scenes.protocol import answer, call

ASKED, LATCH, STOP = 0.08, 0.2, 0.5
PLACE_ERROR = 0.0015
FIRST, PULSE_S, SEEN = 0.03, 0.05, 0.009
"""The first short push, how long it lasts, and the way that counts as seen."""
WAIT_S, GROWTH, AWAY = 3.5, 1.3, 0.44
NEAREST, FARTHEST, CALLS = 0.212, 0.46, 149
SERIES = ((0.4, 0.32, 0.27), (0.42, 0.33, 0.27, 0.24), (0.42, 0.32, 0.26, 0.23), (0.42, 0.33, 0.265, 0.225, 0.217))
LAST = (0.42, 0.32, 0.255, 0.22, 0.213)
"""Distances one after the other: never so much nearer at once that the magnet swings past the latch."""
FREE = {"power": (0.5, 5.0), "deep": (0.005, 0.4), "screened": (0.05, 3.0)}
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


def _fitted(kind, readings):
    """Misfit, logarithm of the repulsion at 0.2 m, and second constant of the best fit."""
    d, push = _points(readings)
    low, high = FREE[kind]

    def off(p):
        slope = (_shape(kind, p[1], d * 1.001) - _shape(kind, p[1], d)) / (0.001 * d)
        misfit = (p[0] + _shape(kind, p[1], d) - np.log(push)) / (slope * PLACE_ERROR)
        return np.append(misfit, 0.1 * np.log(p[1] / np.sqrt(low * high)))

    best = None
    for share in (0.3, 0.6):
        second = low * (high / low) ** share
        first = float(np.mean(np.log(push) - _shape(kind, second, d)))
        got = least_squares(off, (first, second), bounds=((-20, low), (20, high)), x_scale=(1.0, second), max_nfev=60)
        best = got if best is None or got.cost < best.cost else best
    return 2 * best.cost, *best.x


def _best(readings):
    """The structure that fits best, and its constants."""
    fits = {kind: _fitted(kind, readings) for kind in FREE}
    kind = min(fits, key=lambda name: fits[name][0])
    return kind, *fits[kind][1:]


def _push(kind, first, second, d):
    """Repulsion at a distance."""
    return float(np.exp(first + _shape(kind, second, d)))


def _hold(push):
    return [
        call("apply_force", object_id="object_1", force_vector=[-float(f"{push:.6g}"), 0, 0]),
        call("step", duration=WAIT_S),
        call("get_position", object_id="object_1"),
    ]


def _pulse(push):
    return [
        call("apply_force", object_id="object_1", force_vector=[-float(f"{push:.6g}"), 0, 0]),
        call("step", duration=PULSE_S),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        call("step", duration=0.15),
        call("get_position", object_id="object_1"),
        call("step", duration=WAIT_S),
    ]


def solve(task):
    """Short pushes for the scale, small steps of a steady push; then nearer and nearer by the law so far."""
    seen, push, far = [], FIRST / 4, 0.0
    while far < SEEN:
        push *= 4
        calls = _pulse(push)
        seen += zip(calls, (yield calls), strict=True)
        far = STOP - seen[-2][1]["position"][0]
    push *= 0.01 / far
    while len(_points(seen)[0]) < 3 or np.min(_points(seen)[0]) > 0.42:
        calls = []
        for _ in range(3):
            calls += _hold(push)
            push *= GROWTH
        seen += zip(calls, (yield calls), strict=True)
        if seen[-1][1]["position"][0] < AWAY and len(_points(seen)[0]) >= 2:
            break
    for number in range(20):
        law, nearest, calls = _best(seen), min(_points(seen)[0]), []
        series = SERIES[number] if number < len(SERIES) else LAST
        for d in series[: (CALLS - len(seen)) // 3]:
            calls += _hold(_push(*law, max(d, 0.8 * nearest, NEAREST)))
        if not calls:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_push(*_best(seen), ASKED))]


def fit(readings, structure):
    """The force by the law of a structure."""
    return _push(structure, *_fitted(structure, readings)[1:], ASKED)


def structure(knobs):
    """Law of repulsion."""
    return knobs["kind"]


def _true(knobs):
    """Kind, logarithm of the repulsion at 0.2 m, and second constant."""
    second = {"power": "power", "deep": "depth", "screened": "length"}[knobs["kind"]]
    return knobs["kind"], float(np.log(knobs["scale"])), knobs[second]


def theory(knobs):
    """The law at the distance that is asked."""
    return _push(*_true(knobs), ASKED)


def measure(engine, knobs):
    """The magnet in thicker oil, without the latch, held at the distance by a force that follows it."""
    scale = knobs["scale"]
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "joint[guide].damping": 100 * knobs["mass"]})
    free.place("object_1", np.array([ASKED, 0.0, 0.5]), {})
    push, tick = 3 * scale, 1 / free.whole_steps(1.0)
    for _ in range(free.whole_steps(10.0)):
        off = float(free.pose("object_1").position[0]) - ASKED
        push += scale * 400 * tick * off
        free.push("object_1", force=np.array([-push - 40 * scale * off, 0.0, 0.0]))
        free.step(1)
    return push


def naive(knobs):
    """Inverse square from the nearest place; the straight line between 0.4 m and 0.2 m."""
    law = _true(knobs)
    near, far = _push(*law, LATCH), _push(*law, 0.4)
    return {
        "inverse square": (LATCH / ASKED) ** 2 * near,
        "straight line": near + (near - far) / 0.2 * (LATCH - ASKED),
    }


def stage(task):
    """Push as hard as possible, and look where it stays."""
    readings = yield [*_hold(600.0), *_hold(500.0)]
    yield [answer(500.0 * (readings[2]["position"][0] / ASKED) ** 2)]


def batch(task):
    """Pushes in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(20) for asked in _hold(0.03 * 1.66**n)]
    readings = yield calls
    yield [answer(_push(*_best(list(zip(calls, readings, strict=True))), ASKED))]
