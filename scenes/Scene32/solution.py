"""Scene 32: tilt the plate to chosen places around the bearing that is asked, fit the cords, carry the balance on."""

from itertools import product
from math import atan2, hypot

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.protocol import answer, call

LATCH, REACH = 0.12, 0.108
ASKED = (0.3, 0.2)
NO_LATCH = {"body[latch].pos": (0.0, 0.0, 0.0)}
BEARING = atan2(ASKED[1], ASKED[0])
RESOLUTION = 0.00006
WAIT_S = 4.0
SLACK = {"above": (1,), "below": (-1,), "both": (1, -1)}
"""Slack cords, by the side of the asked bearing on which theirs lies."""
TOLD = (0.25, 1.2), (0.4, 5.0), (0.03, 0.09)
"""Ranges of a slack cord: bearing from the asked one, stiffness over that of all taut cords, and slack."""
PRESSED, PRESSES = 0.002, 3
"""A slack cord is known once it was stretched so far, so many times."""
ROUNDS = (
    (0.0, ((0.4, 0), (0.4, 90), (0.4, -90), (0.65, 0))),
    (0.0, ((0.75, 35), (0.75, -35), (0.75, 70), (0.75, -70))),
    (0.5, ((0.85, 0), (0.85, 50), (0.85, -50), (0.85, 20))),
    (0.8, ((0.95, 0), (0.95, 35), (0.95, -35), (0.95, 65))),
    (0.9, ((0.97, -65), (0.97, 20), (0.97, -20), (0.97, 45))),
    (0.95, ((1, 0), (1, -45), (1, 30), (1, -30))),
)
"""How far the slack cords of the fit so far are trusted; shares of the reach and bearings from the asked one."""


def _load(p, sides, a, b):
    """Torques at both axles that hold the plate: p has the matrix of the taut cords, then bearing, stiffness, slack."""
    first, second = p[0] * a + p[1] * b, p[1] * a + p[2] * b
    for number in range(len(sides)):
        bearing, stiffness, slack = p[3 + 3 * number : 6 + 3 * number]
        pull = stiffness * np.maximum(a * np.cos(bearing) + b * np.sin(bearing) - slack, 0)
        first, second = first + pull * np.cos(bearing), second + pull * np.sin(bearing)
    return first, second


def _points(readings):
    """Torques at both axles and angles of rest, up to the latch."""
    torques, points, a = [0.0, 0.0], [], 0.0
    for asked, got in readings:
        number = int(asked.arguments.get("object_id", "object_1")[-1]) - 1
        if asked.tool == "apply_torque":
            torques[number] = asked.arguments["torque_vector"][number]
        elif asked.tool == "get_position" and number == 0:
            a = got["angle"]
        elif asked.tool == "get_position":
            if hypot(a, got["angle"]) > LATCH:
                break
            points.append((torques[0], torques[1] * np.cos(a), a, got["angle"]))
    return np.array(points or [(0.0, 0.0, 0.0, 0.0)]).T


def _linear(points):
    """Matrix of the taut cords alone, from the smallest tilts."""
    first, second, a, b = points
    zero = np.zeros_like(a)
    rows = np.concatenate((np.column_stack([a, b, zero]), np.column_stack([zero, a, b])))
    near = 1 / np.tile(0.003 + np.hypot(a, b), 2)[:, None] ** 1.5
    found = np.linalg.lstsq(rows * near, np.concatenate((first, second)) * near[:, 0], rcond=None)[0]
    return np.array([max(found[0], 0.02), found[1], max(found[2], 0.02)])


def _fitted(kind, points):
    """Misfit and the parameters of the cords that fit best."""
    first, second, a, b = points
    sides, start = SLACK[kind], _linear(points)
    scale = (start[0] + start[2]) / 2
    low = [0, -np.inf, 0] + [v for s in sides for v in (BEARING + (0.05 if s > 0 else -1.5), 0, 0.02)]
    high = [np.inf] * 3 + [v for s in sides for v in (BEARING + (1.5 if s > 0 else -0.05), 15 * scale, 0.1)]
    sizes = [scale, scale, scale, *(0.5, scale, 0.02) * len(sides)]

    def off(p):
        held = _load(p, sides, a, b)
        return np.concatenate((held[0] - first, held[1] - second)) / (2 * scale * RESOLUTION)

    best = None
    for away, slack in product((0.4, 0.9), (0.05, 0.07)):
        guess = [*start, *(v for side in sides for v in (BEARING + side * away, scale, slack))]
        got = least_squares(off, guess, bounds=(low, high), x_scale=sizes, max_nfev=25)
        best = got if best is None or got.cost < best.cost else best
    best = least_squares(off, best.x, bounds=(low, high), x_scale=sizes, max_nfev=60)
    return 2 * best.cost, best.x


def _best(points):
    """The structure that fits best, with a price for each parameter, and its parameters."""
    fits = {kind: _fitted(kind, points) for kind in SLACK}
    price = 3 * np.log(2 * len(points[0]))
    kind = min(fits, key=lambda name: fits[name][0] / 2 + price * len(SLACK[name]))
    return kind, fits[kind][1]


def _trusted(kind, p, points):
    """The fit without the slack cords that were hardly stretched so far: their stiffness is not known yet."""
    p = np.array(p)
    for number in range(len(SLACK[kind])):
        bearing, _, slack = p[3 + 3 * number : 6 + 3 * number]
        if np.sum(points[2] * np.cos(bearing) + points[3] * np.sin(bearing) - slack > PRESSED) < PRESSES:
            p[4 + 3 * number] = 0.0
    return p


def _predict(kind, p):
    return [float(torque) for torque in _load(p, SLACK[kind], *ASKED)]


def _apply(first, second):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[float(f"{first:.6g}"), 0, 0]),
        call("apply_torque", object_id="object_2", torque_vector=[0, float(f"{second:.6g}"), 0]),
        call("step", duration=WAIT_S),
        call("get_position", object_id="object_1"),
        call("get_position", object_id="object_2"),
    ]


def solve(task):
    """Weak torques for the scale, then chosen tilts, farther as the cords become known."""
    seen = []
    for torque in (0.003, 0.02, 0.12):
        calls = _apply(torque, 0)
        seen += zip(calls, (yield calls), strict=True)
        if hypot(seen[-1][1]["angle"], seen[-2][1]["angle"]) > 0.004:
            break
    calls = [*_apply(0, torque), *_apply(-torque / 2, torque / 2)]
    seen += zip(calls, (yield calls), strict=True)
    kind, plan = None, _linear(_points(seen))
    for trust, ways in ROUNDS:
        calls = []
        for share, degrees in ways:
            bearing = BEARING + np.radians(degrees)
            place = REACH * share * np.cos(bearing), REACH * share * np.sin(bearing)
            alone, held = (_load(plan, sides, *place) for sides in ((), SLACK.get(kind, ())))
            first, second = (x + trust * (h - x) for x, h in zip(alone, held, strict=True))
            calls += _apply(float(first), float(second / np.cos(place[0])))
        seen += zip(calls, (yield calls), strict=True)
        kind, p = _best(_points(seen))
        plan = _trusted(kind, p, _points(seen))
    yield [answer(_predict(kind, p))]


def fit(readings, structure):
    """Both torques by the cords of a structure."""
    return _predict(structure, _fitted(structure, _points(readings))[1])


def _weighed(kind, points):
    """Cords of a structure, fitted to the angles: matrix of the taut ones over its first guess, then as in `TOLD`."""
    first, second, a, b = points
    sides, start = SLACK[kind], _linear(points)
    usual = start[0] + start[2]

    def cords(constants):
        p = [usual * value for value in constants[:3]]
        for number, side in enumerate(sides):
            away, stiffness, slack = constants[3 + 3 * number : 6 + 3 * number]
            p += [BEARING + side * away, stiffness * (p[0] + p[2]), slack]
        return np.array(p)

    def misfits(constants):
        p = cords(constants)
        here, along, across = (np.array(_load(p, sides, a + u, b + v)) for u, v in ((0, 0), (1e-5, 0), (0, 1e-5)))
        slopes = np.stack([along - here, across - here], axis=-1).transpose(1, 0, 2) / 1e-5
        lack = (here - np.array([first, second])).T
        return np.linalg.solve(slopes, lack[:, :, None]).ravel() / RESOLUTION

    ranges = [(0.02, 1.5), (-1.0, 1.0), (0.02, 1.5), *TOLD * len(sides)]
    low, high = np.array(ranges).T
    fits = []
    for away, slack in product((0.4, 0.9), (0.05, 0.07)):
        guess = np.clip([*start / usual, *(away, 0.8, slack) * len(sides)], low + 1e-3, high - 1e-3)
        fits.append(least_squares(misfits, guess, bounds=(low, high), x_scale=high - low, max_nfev=100))
    best = min(fits, key=lambda found: found.cost).x
    return member(misfits, lambda constants: _predict(kind, cords(constants)), best, ranges)


def rivals(readings):
    """Cords of every structure, fitted."""
    points = _points(readings)
    return {kind: _weighed(kind, points) for kind in SLACK}


def _true(knobs):
    p = [knobs["kxx"], knobs["kxy"], knobs["kyy"]]
    for number, side in ((3, 1), (4, -1)):
        if side in SLACK[knobs["kind"]]:
            p += [knobs[f"p{number}"], knobs[f"k{number}"], knobs[f"g{number}"]]
    return p


def naive(knobs):
    """The taut cords alone; all cords without slack."""
    p = _true(knobs)
    tight = [0.0 if n > 2 and n % 3 == 2 else v for n, v in enumerate(p)]
    return {
        "weak torques in proportion": [float(torque) for torque in _load(p, (), *ASKED)],
        "no slack": _predict(knobs["kind"], np.array(tight)),
    }


def stage(task):
    """Turn both axles as hard as seems needed and carry the tilt on in proportion."""
    readings = yield _apply(3.0, 2.0)
    share = hypot(*ASKED) / max(hypot(readings[-1]["angle"], readings[-2]["angle"]), 1e-4)
    yield [answer([3.0 * share, 2.0 * share])]


def batch(task):
    """Four strengths, each in three directions, the weakest first."""
    calls = []
    for torque in (0.02, 0.08, 0.3, 1.0):
        for degrees in (0, 50, -50):
            bearing = BEARING + np.radians(degrees)
            calls += _apply(float(torque * np.cos(bearing)), float(torque * np.sin(bearing)))
    readings = yield calls
    yield [answer(_predict(*_best(_points(list(zip(calls, readings, strict=True))))))]


def predict(structure, knobs):
    """Torques of all cords at the asked tilt."""
    return _predict(structure, _true({**knobs, "kind": structure}))


def measure(engine, knobs):
    """Without the latch: held by strong springs whose rest is moved until the plate is where it is asked."""
    free = engine.changed(NO_LATCH)
    rest, gain = np.array(ASKED), 30 * knobs["scale"]
    torques = np.zeros(2)
    for _ in range(8):
        for _ in range(free.whole_steps(1.0)):
            now = np.array([free.turn("object_1").angle, free.turn("object_2").angle])
            torques = gain * (rest - now)
            free.push("object_1", torque=np.array([torques[0], 0.0, 0.0]))
            free.push("object_2", torque=torques[1] * np.array([0.0, np.cos(now[0]), np.sin(now[0])]))
            free.step(1)
        rest = rest + np.array(ASKED) - [free.turn("object_1").angle, free.turn("object_2").angle]
    return [float(torque) for torque in torques]


def settles(engine, knobs, off):
    """Where the plate comes to rest under the asked torques after it was near by; the larger share of both angles."""
    free, p = engine.changed(NO_LATCH), _true(knobs)
    for a, b in (np.array(ASKED) * (1 + off), ASKED):
        first, second = _load(p, SLACK[knobs["kind"]], a, b)
        free.push("object_1", torque=np.array([first, 0.0, 0.0]))
        free.push("object_2", torque=second * np.array([0.0, np.cos(a), np.sin(a)]))
        free.step(free.whole_steps(8.0))
    found = np.array([free.turn(body).angle for body in ("object_1", "object_2")])
    return float(max(found / ASKED - 1, key=abs))
