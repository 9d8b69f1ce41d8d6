"""Scene 29: lead the arm to many steady spins, read the slider, fit the springs' pull, balance it at 9 rad/s."""

import numpy as np
from scipy.optimize import least_squares, nnls

from scenes.family import member
from scenes.protocol import answer, call

START_M, ASKED, GUARD = 0.2, 9.0, 6.0
PLACE_ERROR, SPIN_ERROR = 0.0007, 0.003
WAIT_S, FIRST, GROWTH = 2.5, 0.06, 6.0
SPINS = ((2.0, 3.0), (4.0, 4.5), (4.8, 5.1), (5.3, 5.5), (5.6, 5.75), (5.8, 5.4, 5.0), (4.3, 3.7, 5.2))
MORE = ((5.85, 5.6, 5.3), (4.6, 5.8, 5.4), (3.3, 5.1, 5.7), (5.85, 4.8, 5.5), (5.85, 4.0, 5.2), (5.85, 5.85, 5.0))
CALLS = 149
NAMES = ("s0", "s1", "s2", "r1", "b", "power")
FREE = {"two": (1, 2, 3), "stiffening": (1, 4, 5), "preload": (0, 1)}
"""Which of the parameters a structure has; the others are 0."""
LOW, HIGH = np.array([0.8, 5.0, 30.0, 0.21, 0.1, 2.0]), np.array([7.2, 500.0, 600.0, 0.6, 2e3, 5.0])
STARTS = (np.array([2.0, 120.0, 200.0, 0.3, 30.0, 3.0]), np.array([4.0, 60.0, 150.0, 0.38, 5.0, 4.0]))
LATEST, LEAST_PART, RATIO = 5.8, 0.1, (0.6, 7.0)
"""As told: spin at which the second spring has joined in, part of the growing pull, ratio of stiffnesses."""


def _pull(p, r):
    """Pull over the mass of the slider."""
    y = r - START_M
    return (
        p[0] * np.tanh(y / 1e-3) + p[1] * y + p[2] * np.maximum(r - p[3], 0) + p[4] * (np.maximum(y, 0) / 0.2) ** p[5]
    )


def _distance(p, spin):
    """Distance of the slider at steady spins, by halving."""
    spin = np.asarray(spin, dtype=float)
    low, high = np.full(spin.shape, START_M), np.full(spin.shape, 5.0)
    for _ in range(45):
        middle = (low + high) / 2
        out = spin**2 * middle > _pull(p, middle)
        low, high = np.where(out, middle, low), np.where(out, high, middle)
    return (low + high) / 2


def _points(readings):
    """Spins and distances in steady states, until the guard grips."""
    points, distance = [], START_M
    for asked, got in readings:
        if asked.tool == "get_position":
            distance = float(np.hypot(*got["position"][:2]))
        elif asked.tool == "get_velocity":
            if points and got["angular_velocity"] < 0.1 < points[-1][0]:
                break
            points.append((got["angular_velocity"], distance))
    return np.array(points).T


def _told(kind, p):
    """By how much the parameters are off what the task tells, in thousandths."""
    if kind == "two":
        ratio = p[2] / p[1]
        return [max(LATEST**-2 * _pull(p, p[3]) / p[3] - 1, 0) / 1e-3, (ratio - np.clip(ratio, *RATIO)) / 1e-3]
    if kind == "stiffening":
        y = float(_distance(p, GUARD)) - START_M
        return [max(LEAST_PART - p[4] * (y / 0.2) ** p[5] / (GUARD**2 * (y + START_M)), 0) / 1e-3, 0.0]
    return [0.0, 0.0]


def _misfits(kind, readings):
    """Logarithms of the free parameters → misfits of the distances, in their errors."""
    spin, distance = _points(readings)

    def misfits(logs):
        p = _full(kind, logs)
        here, next_to = _distance(p, spin), _distance(p, spin + 0.01)
        off = (here - distance) / np.hypot(PLACE_ERROR, (next_to - here) / 0.01 * SPIN_ERROR)
        return np.append(off, _told(kind, p))

    return misfits


def _full(kind, logs):
    p = np.zeros(len(NAMES))
    p[list(FREE[kind])] = np.exp(logs)
    return p if p[3] else p + np.where(np.array(NAMES) == "r1", START_M, 0.0)


def _edges(kind):
    free = list(FREE[kind])
    return np.log([LOW[free], HIGH[free]])


def _fitted(kind, readings):
    """Misfit and logarithms of the parameters of a structure that fit best."""
    misfits, edges = _misfits(kind, readings), _edges(kind)
    tried = [least_squares(misfits, np.log(start[list(FREE[kind])]), bounds=edges, max_nfev=60) for start in STARTS]
    best = min(tried, key=lambda got: got.cost)
    return 2 * best.cost, best.x


def _best(readings):
    """The parameters of the structure that fits best, with a price for each."""
    fits = {kind: _fitted(kind, readings) for kind in FREE}
    kind = min(fits, key=lambda name: fits[name][0] + 4 * len(FREE[name]))
    return _full(kind, fits[kind][1])


def _predict(p):
    return float(_distance(p, ASKED))


def _turn(torque):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, float(f"{torque:.5g}")]),
        call("step", duration=WAIT_S),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_1"),
    ]


def _torque(seen, spin):
    """Torque for a spin, by a resistance with the spin and its square as so far."""
    spins = _points(seen)[0]
    torques = np.array([asked.arguments["torque_vector"][2] for asked, _ in seen if asked.tool == "apply_torque"])
    sizes = nnls(np.column_stack([spins, spins**2]) / torques[:, None], np.ones(len(torques)))[0]
    return float(sizes @ (spin, spin**2))


def solve(task):
    """A weak torque, growing until the arm turns; then spins up to the guard, two or three at a time."""
    seen, torque = [], FIRST
    while not seen or seen[-1][1]["angular_velocity"] < 0.2:
        calls = _turn(torque)
        torque *= GROWTH
        seen += zip(calls, (yield calls), strict=True)
    for spins in ((1.0,), *SPINS, *MORE):
        calls = []
        for spin in spins[: (CALLS - len(seen)) // 4]:
            calls += _turn(_torque(seen, spin))
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(_best(seen)))]


def fit(readings, structure):
    """The distance by the springs of a structure."""
    return _predict(_full(structure, _fitted(structure, readings)[1]))


def rivals(readings):
    """The springs of every kind, fitted."""
    return {
        kind: member(
            _misfits(kind, readings),
            lambda logs, kind=kind: _predict(_full(kind, logs)),
            _fitted(kind, readings)[1],
            _edges(kind).T.tolist(),
        )
        for kind in FREE
    }


def _true(knobs):
    return np.array([knobs[name] for name in NAMES], dtype=float)


def naive(knobs):
    """One spring for all, by the distance near the guard; a way in proportion to the square of the spin."""
    p = _true(knobs)
    near = float(_distance(p, GUARD))
    single = np.array([0, GUARD**2 * near / (near - START_M), 0, START_M, 0, 1])
    return {
        "one spring": _predict(single),
        "way as the square of the spin": START_M + (near - START_M) * (ASKED / GUARD) ** 2,
    }


def stage(task):
    """Turn as fast as possible."""
    readings = yield [*_turn(5.0), *_turn(90.0)]
    yield [answer(float(np.hypot(*readings[6]["position"][:2])))]


def batch(task):
    """Torques in even ratios over the whole range, and the same fit."""
    calls = [asked for n in range(15) for asked in _turn(0.08 * 1.6**n)]
    readings = yield calls
    yield [answer(_predict(_best(list(zip(calls, readings, strict=True)))))]


def theory(knobs):
    """Balance of pull and spin at the spin that is asked."""
    return _predict(_true(knobs))


def _turned(engine, knobs, start):
    """Distance of the slider in the end, from a distance at the start, with the torque for the asked spin."""
    free = engine.changed({"body[most].pos": (100.0, 0.0, 0.0), "body[object_2].pos": (start, 0.0, 0.0)})
    torque = knobs["drag"] * (ASKED + knobs["bend"] * ASKED**2 / 5)
    free.push("object_1", torque=np.array([0.0, 0.0, torque]))
    free.step(free.whole_steps(25.0))
    return float(np.hypot(*free.pose("object_2").position[:2]))


def measure(engine, knobs):
    """The arm in the engine, without the guard, under the torque for the asked spin."""
    return _turned(engine, knobs, START_M)


def settles(engine, knobs, off):
    """By which share the slider is off in the end, if it starts near the asked distance."""
    return _turned(engine, knobs, (1 + off) * theory(knobs)) / theory(knobs) - 1
