"""Scene 37: hold the lever at many angles up to the pawl, fit what is in it, carry it on to 1 rad."""

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

ASKED, PAWL = 1.0, 0.6
ANGLE_ERROR = 0.00102
FIRST, GROWTH, SEEN, WAIT_S = 0.02, 6.0, 0.025, 4.0
FARTHEST, CALLS = 0.58, 149
SERIES = ((0.12, 0.18), (0.24, 0.29), (0.33, 0.37), (0.4, 0.43), (0.3, 0.36, 0.46), (0.35, 0.41, 0.47, 0.5))
MORE = (
    (0.4, 0.48, 0.53),
    (0.38, 0.46, 0.52, 0.56),
    (0.45, 0.53, 0.575),
    (0.42, 0.5, 0.55, 0.58),
    (0.34, 0.44, 0.54, 0.58),
)
LAST = (0.48, 0.53, 0.56, 0.58, 0.585)
"""Angles one after the other: never so much farther at once that the lever swings past the pawl."""
STRENGTH = {"shift": (0.05, 1.0), "cord": (0.1, 8.0), "load": (0.1, 3.0)}
"""Range of what a structure adds, over the torque of the weight; it acts beyond an angle in WHERE."""
WHERE = 0.2, 0.5


def _shape(kind, strength, where, angle):
    """Torque of rest at angles above 0, over that of the fixed weight at a right angle."""
    beyond = np.maximum(angle - where, 0)
    if kind == "shift":
        more = -np.maximum(np.sin(angle) - np.sin(where), 0) * np.cos(angle)
    elif kind == "cord":
        more = beyond
    else:
        more = np.cos(angle) * np.minimum(1, beyond / 0.04)
    return np.sin(angle) + strength * more


def _points(readings):
    """Angles and torques of rest, before the pawl."""
    torque, points = 0.0, []
    for asked, got in readings:
        if asked.tool == "apply_torque":
            torque = asked.arguments["torque_vector"][1]
        elif asked.tool == "get_position":
            if abs(got["angle"]) > PAWL + 0.005:
                break
            points.append((got["angle"], torque))
    return np.array(points or [(0.1, 1.0)]).T


def _off(kind, p, angle, torque):
    """Misfits of angles, in standard deviations."""
    slope = (_shape(kind, *p[1:], angle + 2e-3) - _shape(kind, *p[1:], angle - 2e-3)) / 4e-3
    return (_shape(kind, *p[1:], angle) - torque / np.exp(p[0])) / (np.maximum(slope, 0.1) * ANGLE_ERROR)


def _fitted(kind, readings, tried=3):
    """Misfit, and logarithm of the torque of the weight, strength and angle of the best fit."""
    angle, torque = _points(readings)
    low, high = (np.array(ends) for ends in zip((-12.0, 12.0), STRENGTH[kind], WHERE, strict=True))

    def off(p):
        return _off(kind, p, angle, torque)

    starts = []
    for where in np.linspace(0.22, 0.49, 15):
        for strength in STRENGTH[kind][0] * (STRENGTH[kind][1] / STRENGTH[kind][0]) ** np.array([0.3, 0.6, 0.8, 0.95]):
            shape = _shape(kind, strength, where, angle)
            p = np.array([np.log(max(float(shape @ torque / (shape @ shape)), 1e-5)), strength, where])
            starts.append((float(off(p) @ off(p)), tuple(p)))
    best = None
    for _, p in sorted(starts)[:tried]:
        got = least_squares(off, p, bounds=(low, high), max_nfev=40)
        best = got if best is None or got.cost < best.cost else best
    return 2 * best.cost, best.x


def _best(readings, tried=3):
    """The structure that fits best, and its constants."""
    fits = {kind: _fitted(kind, readings, tried) for kind in STRENGTH}
    kind = min(fits, key=lambda name: fits[name][0])
    return kind, fits[kind][1]


def _torque(kind, p, angle):
    return float(np.exp(p[0]) * _shape(kind, *p[1:], angle))


def _hold(torque):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, float(f"{torque:.6g}"), 0]),
        call("step", duration=WAIT_S),
        call("get_position", object_id="object_1"),
    ]


def solve(task):
    """Weak torques for the scale, then angles farther and farther by what fits so far."""
    seen, torque = [], FIRST
    while not seen or seen[-1][1]["angle"] < SEEN:
        calls = _hold(torque)
        torque *= GROWTH
        seen += zip(calls, (yield calls), strict=True)
    for number in range(14):
        law, farthest, calls = _best(seen, 1), max(_points(seen)[0]), []
        series = (*SERIES, *MORE, LAST, LAST, LAST)[number]
        held = dict(zip(*_points(seen), strict=True))[farthest]
        for wanted in series[: (CALLS - len(seen)) // 3]:
            angle = min(wanted, farthest + 0.06, FARTHEST)
            careful = held * max(angle / farthest, 1.0) if angle > farthest - 0.01 else held
            calls += _hold(min(_torque(*law, angle), careful))
        if not calls:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_torque(*_best(seen), ASKED))]


def fit(readings, structure):
    """The torque by what a structure has."""
    return _torque(structure, _fitted(structure, readings)[1], ASKED)


def rivals(readings):
    """Everything that may be on the lever, fitted."""
    angle, torque = _points(readings)
    found = {}
    for kind, span in STRENGTH.items():
        best = _fitted(kind, readings)[1]
        found[kind] = member(
            lambda p, kind=kind: _off(kind, p, angle, torque),
            lambda p, kind=kind: _torque(kind, p, ASKED),
            best,
            ((best[0] - 3, best[0] + 3), span, WHERE),
        )
    return found


def predict(structure, knobs):
    """The balance at the angle that is asked."""
    return _torque(*_true(structure, knobs), ASKED)


def _true(kind, knobs):
    """Kind and constants."""
    others = {"shift": "part", "cord": "stiff", "load": "load"}[kind]
    return kind, [float(np.log(knobs["weight"])), knobs[others], knobs["where"]]


def _led(engine, knobs, goal):
    """The lever in the engine without the pawl, led to an angle by a torque that follows it, and this torque."""
    free = engine.changed({"joint[axle].range": (-170.0, 170.0), "body[trigger]/inertial.mass": 1e12})
    torque = 0.0
    for _ in range(free.whole_steps(20.0)):
        now = free.turn("object_1")
        torque += 0.01 * knobs["weight"] * (goal - now.angle)
        held = torque + knobs["weight"] * (4 * (goal - now.angle) - now.spin)
        free.push("object_1", torque=np.array([0.0, held, 0.0]))
        free.step(1)
    return free, torque


def measure(engine, knobs):
    """The torque that keeps the lever in the engine at the angle."""
    return _led(engine, knobs, ASKED)[1]


def settles(engine, knobs, off):
    """Where the lever comes to rest under the asked torque after it was led to an angle near by."""
    free = _led(engine, knobs, ASKED * (1 + off))[0]
    free.push("object_1", torque=np.array([0.0, predict(knobs["kind"], knobs), 0.0]))
    free.step(free.whole_steps(40.0))
    return float(free.turn("object_1").angle) / ASKED - 1


def naive(knobs):
    """The sine of small angles goes on."""
    return {"sine from small angles": float(_torque(*_true(knobs["kind"], knobs), 0.05) * np.sin(ASKED) / np.sin(0.05))}


def stage(task):
    """Turn it as far as it goes."""
    readings = yield [*_hold(700.0), *_hold(400.0)]
    yield [answer(700.0 * ASKED / max(abs(readings[2]["angle"]), 0.1) * 2)]


def batch(task):
    """Torques in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(20) for asked in _hold(0.012 * 1.85**n)]
    readings = yield calls
    yield [answer(_torque(*_best(list(zip(calls, readings, strict=True))), ASKED))]
