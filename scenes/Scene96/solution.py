"""Scene 96: turn the driver step by step to a lag just below that of the shield; fit the laws to angles and speeds."""

from math import pi

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

WHEEL, DRIVER = "object_1", "object_2"
STIFF, CATCH = 5.0, 0.2
PAIRS, DRAGS = (1, 2, 3), {"even": 1, "square": 2}
NOISE_RAD, NOISE_RAD_S = 5.8e-4, 1.5e-3
"""Standard deviation of a lag and of a spin that is read."""
STEADY_RAD = 0.02
"""Lag from which on the spin is steady when it is read."""
FIRST_NM, GROWTH, SEEN_RAD, SETTLE_S, SHORT_S = 0.0006, 4.0, 0.028, 2.5, 0.05
GOALS = ((0.07, 1), (0.1, 7), (0.125, 1), (0.145, 1), (0.158, 1), (0.168, 2), (0.177, 3), (0.185, 10))
"""Lags that are aimed at, and how many short looks follow the first at each."""


def _turn(torque, looks=0):
    """Turn the driver, wait, and read; then look some more times at both angles."""
    angles = [call("get_position", object_id=WHEEL), call("get_position", object_id=DRIVER)]
    calls = [call("apply_torque", object_id=DRIVER, torque_vector=[0, 0, float(torque)])]
    calls += [call("step", duration=SETTLE_S), *angles, call("get_velocity", object_id=WHEEL)]
    return calls + [call("step", duration=SHORT_S), *angles] * looks


def _rows(exchanges):
    """Torque, mean lag, number of looks and spin of each turn, until the shield has come."""
    rows, torque, angle = [], 0.0, 0.0
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "apply_torque":
            torque = asked.arguments["torque_vector"][2]
            rows.append([torque, [], 0.0])
        elif asked.tool == "get_velocity":
            rows[-1][2] = reading["angular_velocity"]
        elif asked.tool == "get_position":
            if asked.arguments["object_id"] == DRIVER:
                if abs(reading["angle"] - angle) > CATCH + 0.003:
                    rows.pop()
                    break
                rows[-1][1].append(reading["angle"] - angle)
            angle = reading["angle"]
    return np.array([(torque, np.mean(lags), len(lags), spin) for torque, lags, spin in rows]).reshape(-1, 4)


def _pull(pairs, rows):
    """Misfit, and the greatest torque of the magnets."""
    torque, lag, looks, _ = rows.T
    most = np.geomspace(1.0, 12.0, 12001)[:, None] * torque.max()
    model = np.where(most > torque, np.arcsin(np.minimum(torque / most, 1.0)) / pairs, 9.0)
    misfit = ((model - lag) ** 2 * looks).sum(axis=1) / NOISE_RAD**2
    best = int(np.argmin(misfit))
    return float(misfit[best]), float(most[best, 0])


def _resistance(power, rows):
    """Misfit, and the resistance as a function of the spin."""
    torque, _, _, spin = rows[rows[:, 3] > 0.02].T

    def at(edge):
        table = np.column_stack([spin**power, np.maximum(spin - edge, 0.0)])
        size = (power * torque / spin + 0.8 * torque.max() / spin.max() * (spin > edge)) * NOISE_RAD_S
        found = np.linalg.lstsq(table / size[:, None], torque / size, rcond=None)[0]
        return float((((table @ found - torque) / size) ** 2).sum()) + 1e3 * float((found < 0).sum()), found, edge

    near = min((at(edge) for edge in np.linspace(0.5, 1.0, 101) * spin.max()), key=lambda tried: tried[0])[2]
    fine = near + np.linspace(-0.006, 0.006, 41) * spin.max()
    return min((at(edge) for edge in fine), key=lambda tried: tried[0])


def _together(pairs, power, rows):
    """Misfit; spin and torque at which the magnets let go."""
    (lags, most), (spins, (liquid, brake), edge) = _pull(pairs, rows), _resistance(power, rows)
    left = lambda spin: liquid * spin**power + brake * max(spin - edge, 0.0) - most  # noqa: E731
    low, high = 0.0, 1.0
    while left(high) < 0 and high < 1e6:
        high *= 2
    return lags + spins, [float(brentq(left, low, high)) if high < 1e6 else 1.0, most]


def _best(rows):
    """The prediction of the laws that fit best."""
    return min(_together(pairs, power, rows) for pairs in PAIRS for power in DRAGS.values())[1]


def fit(readings, structure):
    """The prediction with a number of pairs and a kind of liquid."""
    pairs, drag = structure.split()
    return _together(int(pairs), DRAGS[drag], _rows(readings))[1]


def _weighed(pairs, power, rows):
    """The laws with a number of pairs and a power of the spin, fitted to the lags and the spins.

    Constants: torque at which the magnets let go, over the largest one so far; that of the liquid and that of the brake
    per spin at the largest spin so far, over the same torque; and the spin from which the brake acts, over that one.
    """
    torque, lag, looks, spin = rows.T
    unit, fastest = torque.max(), spin.max()

    def kept(constants, torque):
        """Spins at which liquid and brake take up a torque."""
        _, liquid, brake, edge = constants
        alone = (torque / liquid) ** (1 / power)
        even = torque + brake * edge
        both = even / (liquid + brake) if power == 1 else 2 * even / (brake + np.sqrt(brake**2 + 4 * liquid * even))
        return fastest * np.where(alone > edge, both, alone)

    def misfits(constants):
        turned = np.arcsin(np.minimum(torque / unit / constants[0], 1.0)) / pairs
        ahead = (turned - lag) * np.sqrt(looks) / NOISE_RAD
        return np.concatenate([ahead, (kept(constants, torque / unit) - spin) / NOISE_RAD_S])

    def prediction(constants):
        return [float(kept(constants, constants[0])), float(unit * constants[0])]

    _, (liquid, brake), edge = _resistance(power, rows)
    start = [_pull(pairs, rows)[1] / unit, liquid * fastest**power / unit, brake * fastest / unit, edge / fastest]
    ranges = [(1.0, 12.0), (0.01, 3.0), (0.0, 30.0), (0.3, 1.0)]
    low, high = np.array(ranges).T
    best = least_squares(misfits, np.clip(start, low + 1e-3, high - 1e-3), bounds=(low, high), x_scale=0.1).x
    return member(misfits, prediction, best, ranges)


def rivals(readings):
    """Each number of pairs with each kind of liquid, fitted."""
    rows = _rows(readings)
    rows = rows[rows[:, 1] > STEADY_RAD]
    return {f"{pairs} {drag}": _weighed(pairs, power, rows) for pairs in PAIRS for drag, power in DRAGS.items()}


def solve(task):
    """Multiply a tiny torque until the driver turns ahead of the wheel, then scale it to reach each target lag."""
    torque, calls, seen, lag = FIRST_NM, [call("find_objects"), *_turn(FIRST_NM)], [], 0.0
    while lag < SEEN_RAD:
        seen += zip(calls, (yield calls), strict=True)
        lag = _rows(seen)[-1, 1]
        if lag < SEEN_RAD:
            torque *= GROWTH
            calls = _turn(torque)
    for goal, looks in GOALS:
        torque *= goal / lag
        calls = _turn(torque, looks)
        seen += zip(calls, (yield calls), strict=True)
        lag = _rows(seen)[-1, 1]
    yield [answer(_best(_rows(seen)))]


def batch(task):
    """Torques in even ratios, and the best fit."""
    calls = [call("find_objects")]
    for rung in range(11):
        calls += _turn(0.003 * 2.1**rung)
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 1 and rows[-1, 3] > 0.02 else [1.0, 1.0])]


def stage(task):
    """Turn the driver harder and harder, and look when the wheel falls behind."""
    calls = [call("find_objects")]
    for rung in range(28):
        calls += _turn(0.001 * 1.4**rung)
    rows = _rows(list(zip(calls, (yield calls), strict=True)))
    yield [answer([float(rows[-1, 3]), float(rows[-1, 0])] if len(rows) else [1.0, 1.0])]


def structure(knobs):
    """Pairs of poles, and how the liquid resists."""
    return f"{knobs['pairs']} {knobs['drag']}"


def _spin(knobs, torque, more):
    """Spin at which liquid and brake take up a torque."""
    reach, power = knobs["reach"], DRAGS[knobs["drag"]]
    top = STIFF * knobs["scale"] * np.sin(CATCH * knobs["pairs"]) / knobs["pairs"]

    def left(spin):
        share = spin / reach
        return top * (share**power + more * max(share - knobs["share"], 0.0)) - torque

    return float(brentq(left, 0.0, 100 * reach))


def theory(knobs):
    """Spin and torque where the sine is 1."""
    torque = STIFF * knobs["scale"] / knobs["pairs"]
    return [_spin(knobs, torque, knobs["more"]), torque]


def naive(knobs):
    """No brake; it lets go where the shield comes."""
    torque = theory(knobs)[1]
    at_shield = torque * float(np.sin(CATCH * knobs["pairs"]))
    return {
        "no brake": [_spin(knobs, torque, 0.0), torque],
        "shield": [_spin(knobs, at_shield, knobs["more"]), at_shield],
    }


def measure(engine, knobs):
    """Greatest torque of the magnets on a heavy wheel that turns past a heavy driver; then the spin that it keeps."""
    heavy = 1e4 * knobs["scale"]
    held = engine.changed(
        {"joint[axle].armature": heavy, "joint[shaft].armature": 1e6, "body[shield]/inertial.mass": 1e12}
    )
    held.push(WHEEL, torque=np.array([0.0, 0.0, heavy / held.timestep]))
    held.step(1)
    held.push(WHEEL, torque=np.zeros(3))
    spins = [held.turn(WHEEL).spin]
    for _ in range(held.whole_steps(2 * pi / knobs["pairs"])):
        held.step(1)
        spins.append(held.turn(WHEEL).spin)
    torques = heavy * np.diff(spins) / held.timestep
    torque = float(torques.max() - torques.min()) / 2
    free = engine.changed({"joint[shaft].armature": 1e6})
    free.place("shield", np.array([0.005, 2.0, 3.0]), {})
    free.push(WHEEL, torque=np.array([0.0, 0.0, torque]))
    free.step(free.whole_steps(4.0))
    return [float(free.turn(WHEEL).spin), torque]
