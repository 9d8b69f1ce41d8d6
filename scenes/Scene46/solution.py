"""Scene 46: turn the handle step by step below the speed of the safety device, and fit the laws of shaft and works."""

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

DIAL, HANDLE = "object_1", "object_2"
ASKED = 1.4
FASTEST, WIDEST = 0.6, 0.9
TOLD, LEAST_SHARE = 0.8, 0.2
"""Angle of the dial at which a part that goes with the cube is at least this share of the torque."""
SIGMA = 2.4e-3
"""Standard deviation of an angle that is read, rad."""
FIRST_NM, LOOK_S, WAIT_S = 0.05, 0.025, 6.0
SINGLY, MOST, LAST = 6, 24, 0.86
"""Steps that are made one by one and watched, most steps, and the angle that is enough."""
SHAFTS = {"even shaft": (1,), "stiff shaft": (1, 3)}
WORKS = {"even works": (1,), "hanging works": (0,), "cubic works": (1, 3)}
"""Powers of the angle that the laws consist of; 0 stands for the sine."""
NO_DEVICE = {"joint[device_joint].damping": 1e9, "body[device].pos": (0.0, 2.0, 1e9)}
"""The apparatus without the safety device: it never moves, and no handle is too fast for it."""
KINDS = [f"{shaft}, {works}" for shaft in SHAFTS for works in WORKS]


def _columns(powers, angle):
    """Torques of unit strength."""
    angle = np.asarray(angle, dtype=float)
    return np.stack([angle**power if power else np.sin(angle) for power in powers], axis=-1)


def _fitted(powers, angles, torques, sigma):
    """Misfit in standard deviations of the angle, and the strengths."""
    table, ahead = _columns(powers, angles), _columns(powers, angles + 1e-4)
    slope = np.full(len(angles), float(torques @ angles / (angles @ angles)))
    for _ in range(4):
        error = sigma * slope
        strengths = np.linalg.lstsq(table / error[:, None], torques / error, rcond=None)[0]
        slope = np.maximum((ahead - table) @ strengths / 1e-4, 0.2 * np.max(slope))
    return float((((table @ strengths - torques) / error) ** 2).sum()) + 1e4 * float(min(strengths) < 0), strengths


def _twist(shaft, strengths, torque):
    """Twist of the shaft under a torque."""
    torque = max(torque, 0.0)
    even, cubic = max(strengths[0], 1e-9), max(strengths[1], 0.0) if len(strengths) > 1 else 0.0
    return brentq(lambda twist: even * twist + cubic * twist**3 - torque, 0.0, torque / even + 1.0)


def _laws(rows, kind):
    """Misfit and answer by laws of one kind."""
    shaft, works = kind.split(", ")
    torques, dial, handle = np.array(rows).T
    first, back = _fitted(WORKS[works], dial, torques, SIGMA)
    second, hold = _fitted(SHAFTS[shaft], handle - dial, torques, 1.4 * SIGMA)
    price = 5 * (len(back) + len(hold))
    return first + second + price, _twist(shaft, hold, float((_columns(WORKS[works], ASKED) @ back).item()))


def _best(rows):
    """The answer by the laws that fit best, each strength paid for."""
    return min(_laws(rows, kind) for kind in KINDS)[1]


def _rows_of(exchanges):
    """Torques and the angles of dial and handle wherever both were at rest within the range."""
    torque, last, dial, rows = 0.0, 0.0, 0.0, []
    for asked, reading in exchanges:
        if asked.tool == "apply_torque":
            torque = asked.arguments["torque_vector"][2]
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position" and last > 1.0:
            if asked.arguments["object_id"] == DIAL:
                before, dial = dial, reading["angle"]
                if dial < 0.9 * before - 0.01 or dial > WIDEST:
                    break
            elif reading["angle"] > 10 * dial + 0.3:  # the shaft is uncoupled
                break
            else:
                rows.append((torque, dial, reading["angle"]))
    return rows


def fit(readings, structure):
    """The answer by laws of one kind."""
    return _laws(_rows_of(readings), structure)[1]


def _angle(powers, strengths, torque):
    """Angle or twist at which a law gives each torque."""
    if powers == (0,):
        return np.arcsin(np.clip(torque / strengths[0], -1.0, 1.0))
    even, cubic = [*strengths, 0.0][:2]
    angle = torque / even
    for _ in range(30):  # Newton's method, which comes down to the root of a convex law
        angle = angle - (even * angle + cubic * angle**3 - torque) / (even + 3 * cubic * angle**2)
    return angle


def _strengths(powers, at, torque, share):
    """Strengths of a law that has a torque at an angle or twist, a share of which goes with the cube."""
    if powers == (0,):
        return [torque / np.sin(at)]
    return [torque * (1 - share) / at, torque * share / at**3][: len(powers)]


def _weighed(rows, kind):
    """The laws of one kind, fitted to the angles of dial and handle.

    Constants: logarithms of the torque with the dial at TOLD and of the twist then, and the shares that go with cubes.
    """
    shaft, works = (laws[name] for laws, name in zip((SHAFTS, WORKS), kind.split(", "), strict=True))
    torques, dial, handle = np.array(rows).T

    def laws(constants):
        (torque, twist), shares = np.exp(constants[:2]), list(constants[2:])
        back = _strengths(works, TOLD, torque, shares.pop(0) if len(works) > 1 else 0.0)
        return back, _strengths(shaft, twist, torque, shares.pop(0) if len(shaft) > 1 else 0.0)

    def misfits(constants):
        back, hold = laws(constants)
        turned = _angle(works, back, torques)
        return np.concatenate([turned - dial, turned + _angle(shaft, hold, torques) - handle]) / SIGMA

    def prediction(constants):
        back, hold = laws(constants)
        return _twist(shaft, hold, float((_columns(works, ASKED) @ back).item()))

    near = int(np.argmin(np.abs(dial - TOLD)))
    logs = np.log([torques[near], max(handle[near] - dial[near], SIGMA)])
    parts = len(works) + len(shaft) - 2
    ranges = [*((log - 3, log + 3) for log in logs), *[(LEAST_SHARE, 1.0)] * parts]
    best = least_squares(misfits, [*logs, *[0.4] * parts], bounds=tuple(zip(*ranges, strict=True))).x
    return member(misfits, prediction, best, ranges)


def rivals(readings):
    """Laws of every kind, fitted."""
    rows = _rows_of(readings)
    return {kind: _weighed(rows, kind) for kind in KINDS}


def _turn(torque):
    return call("apply_torque", object_id=HANDLE, torque_vector=[0, 0, float(f"{torque:.5g}")])


def _rest():
    return [call("step", duration=WAIT_S), *(call("get_position", object_id=body) for body in (DIAL, HANDLE))]


def solve(task):
    """Increase the torque step by step: first one step per iteration, with a reading of the speed, then two."""
    yield [call("find_objects")]
    exchanges, torque, more, number, way = [], 0.0, FIRST_NM, 0, 0.0
    allowed, gained = np.inf, 0.0
    while number < MOST and way < LAST:
        before = way
        if number < SINGLY:
            torque += more
            calls = [_turn(torque), call("step", duration=LOOK_S), call("get_velocity", object_id=HANDLE), *_rest()]
            count = 1
        else:
            count = 1 if WIDEST - way < 2.5 * gained else 2
            calls = []
            for _ in range(count):
                torque += more
                calls += [_turn(torque), *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        way = _rows_of(exchanges)[-1][1]
        if number < SINGLY:
            spin = readings[2]["angular_velocity"]
            allowed = 0.65 * FASTEST * more / max(spin, 0.01)
        number += count
        gained = max((way - before) / count, 2e-3)
        more = min(8 * more, allowed, 0.8 * more * max(WIDEST - way, 0.004) / gained)
    yield [answer(_best(_rows_of(exchanges)))]


def stage(task):
    """Turn the handle with all force, and read where it is."""
    readings = yield [call("find_objects"), _turn(290.0), *_rest()]
    yield [answer(max(abs(readings[-1]["angle"]), 0.01) * ASKED / max(abs(readings[-2]["angle"]), 0.01) - ASKED)]


def batch(task):
    """Torques in even ratios over the whole range, and the same fit."""
    calls = [call("find_objects")]
    for number in range(14):
        calls += [_turn(0.06 * 1.7**number), *_rest()]
    readings = yield calls
    rows = _rows_of(list(zip(calls, readings, strict=True)))
    yield [answer(_best(rows) if len(rows) > 1 else 2.0)]


def structure(knobs):
    """Laws of shaft and works."""
    return knobs["kind"]


def _true(knobs):
    """Strengths of shaft and works."""
    shaft, works = knobs["kind"].split(", ")
    hold = [knobs["c"], knobs["c3"]][: len(SHAFTS[shaft])]
    return hold, [knobs["k"], knobs["k3"]][: len(WORKS[works])]


def theory(knobs):
    """Equal torques of shaft and works."""
    shaft, works = knobs["kind"].split(", ")
    hold, back = _true(knobs)
    return _twist(shaft, hold, float(_columns(WORKS[works], ASKED) @ back))


def naive(knobs):
    """The angles at 0.9 rad in proportion; the stiffnesses at small angles."""
    shaft, works = knobs["kind"].split(", ")
    hold, back = _true(knobs)
    within = _twist(shaft, hold, float(_columns(WORKS[works], WIDEST) @ back))
    return {"in proportion": within * ASKED / WIDEST, "small angles": ASKED / knobs["ratio"]}


def measure(engine, knobs):
    """The engine's handle, held and turned on until the dial is at rest at the asked angle."""
    servo, goal = 300 * (knobs["c"] + knobs["k"]), ASKED
    changes = {**NO_DEVICE, "joint[object_2_joint].stiffness": servo}
    changes |= {"joint[object_2_joint].armature": servo / 500, "joint[object_2_joint].damping": servo / 10}
    free = engine.changed(changes)
    gain = 0.1 * min(1 + 12 * knobs["k3"] / knobs["c"], 6)
    while abs(free.turn(DIAL).angle - ASKED) > 1e-4 or abs(free.turn(DIAL).spin) > 1e-4:
        goal += gain * (ASKED - free.turn(DIAL).angle)
        free.push(HANDLE, torque=np.array([0.0, 0.0, servo * goal]))
        free.step(free.whole_steps(0.1))
    return float(free.turn(HANDLE).angle) - ASKED


def settles(engine, knobs, off):
    """Where the dial ends if it stands near the asked angle and the handle is given the torque of that angle."""
    free = engine.changed(NO_DEVICE)
    works = knobs["kind"].split(", ")[1]
    for angle in (ASKED * (1 + off), ASKED):
        torque = float(_columns(WORKS[works], angle) @ _true(knobs)[1])
        free.push(HANDLE, torque=np.array([0.0, 0.0, torque]))
        free.step(free.whole_steps(60.0))
    return float(free.turn(DIAL).angle) / ASKED - 1
