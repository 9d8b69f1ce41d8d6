"""Scene 45: load the wheel step by step and unload it again; the way back tells which bends were slipping plates."""

from math import cos, pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
WHEEL, LEVER, HEIGHT = "object_1", 0.5, 1.0
FARTHEST, ASKED = 1.2, 0.8
FASTEST, WIDEST = 0.07, 0.4
SIGMA = 4e-4
FIRST_KG = 0.003
LOOK_S, WAIT_S = 0.05, 6.0
STEPS, SINGLY, LAST = 22, 6, 0.37
"""Most balls; how many of them are joined one by one, the others two at a time; and the angle that is enough."""
BACK = 9
"""Balls that are taken away again."""
RADIUS = 0.02
KINDS = {
    "plate": "P",
    "weight": "W",
    "two plates": "PP",
    "plate, then weight": "PW",
    "weight, then plate": "WP",
    "two weights": "WW",
}
GRID = np.arange(0.05, 0.27, 0.01)
APART = 0.035


def _course(angles, sort, bend):
    """Torque of a part of unit stiffness at the angles, which follow each other."""
    angles = np.asarray(angles, dtype=float)
    if sort == "W":
        return np.clip(angles, -bend, bend)
    torques, stretch, before = [], 0.0, 0.0
    for angle in angles:
        stretch = min(max(stretch + angle - before, -bend), bend)
        before = angle
        torques.append(stretch)
    return np.array(torques)


def _table(angles, sorts, bends):
    parts = [_course(angles, sort, bend) for sort, bend in zip(sorts, bends, strict=True)]
    return np.column_stack([np.asarray(angles, dtype=float), *parts])


def _misfit(rows, sorts, bends, scale):
    """Misfit of the best strengths, in units of the resolution, and these strengths."""
    loads, angles = np.array(rows).T
    table = _table(angles, sorts, bends)
    strengths, slope = np.full(1 + len(sorts), scale), np.full(len(angles), scale)
    for _ in range(2):
        error = SIGMA * np.minimum(slope, 5 * scale) + 1e-3 * np.abs(loads)
        strengths, *_ = np.linalg.lstsq(table / error[:, None], loads / error, rcond=None)
        slope = np.full(len(angles), max(strengths[0], 0.05 * scale))
        for sort, bend, strength in zip(sorts, bends, strengths[1:], strict=True):
            held = np.abs(_course(angles, sort, bend)) < bend - 1e-9
            slope = slope + held * max(strength, 0.0)
    misfit = float(np.sum(((table @ strengths - loads) / error) ** 2))
    return misfit + 1e4 * float(np.min(strengths) < 0), strengths


def _fitted(rows, kind):
    """Misfit, strengths and bends of one kind of parts: all bends on a grid, then finer and finer ones."""
    sorts = KINDS[kind]
    scale = max(load for load, _ in rows) / max(angle for _, angle in rows)
    if len(sorts) == 1:
        trials = [(bend,) for bend in GRID]
    else:
        trials = [(one, two) for one in GRID for two in GRID if two - one > APART]
    found = min(((*_misfit(rows, sorts, bends, scale), bends) for bends in trials), key=lambda fit: fit[0])
    step = 0.005
    while step > 3e-4:
        moved = [tuple(found[2] + step * np.array(way)) for way in _ways(len(sorts))]
        moved = [bends for bends in moved if bends[-1] - bends[0] > APART or len(bends) == 1]
        better = min(
            [found, *((*_misfit(rows, sorts, bends, scale), bends) for bends in moved)], key=lambda fit: fit[0]
        )
        if better is not found:
            found = better
        else:
            step /= 2
    return found


def _ways(count):
    if count == 1:
        return [(-1,), (1,)]
    return [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]


def _load(kind, strengths, bends):
    """The asked load: out to the farthest angle and back."""
    torque = (_table([FARTHEST, ASKED], KINDS[kind], bends) @ np.asarray(strengths))[1]
    return float(torque / (GRAVITY * LEVER * cos(ASKED)))


def _best(rows):
    """The asked load by the simplest parts that fit."""
    found = {kind: _fitted(rows, kind) for kind in KINDS}
    kind = min(KINDS, key=lambda kind: found[kind][0] + 12 * len(KINDS[kind]))
    return _load(kind, *found[kind][1:])


def _rows_of(exchanges):
    """Load torque and angle wherever the wheel was at rest within the range."""
    balls, angle, made, rows, last = {}, 0.0, {}, [], 0.0
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            name = asked.arguments["object1_id"]
            balls[name] = (made[name], angle)
        elif asked.tool == "delete_objects":
            balls.pop(asked.arguments["object_id"])
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position":
            angle = reading["angle"]
            if abs(angle) > WIDEST:
                break
            if last > 1.0:
                rows.append((sum(kg * GRAVITY * LEVER * cos(angle - start) for kg, start in balls.values()), angle))
    return rows


def fit(readings, structure):
    """The asked load by one kind of parts."""
    return _load(structure, *_fitted(_rows_of(readings), structure)[1:])


def _ball(number, kg, radius=RADIUS):
    """A ball at the height of the axis, 0.5 m to the right; its place along the axis does not matter."""
    name, side = f"ball{number}", 1 if number % 2 else -1
    return [
        call(
            "create_objects",
            name=name,
            pos=[LEVER, side * (0.1 + 0.05 * (number // 2)), HEIGHT],
            density=kg / (4 / 3 * pi * radius**3),
            rgba=[1, 0, 0, 1],
            radius=radius,
        ),
        call("attach_objects", object1_id=name, object2_id=WHEEL),
    ]


def _look():
    return [call("step", duration=LOOK_S), call("get_velocity", object_id=WHEEL)]


def _rest():
    return [call("step", duration=WAIT_S), call("get_position", object_id=WHEEL)]


def _back(number):
    return [call("delete_objects", object_id=f"ball{number}"), *_rest()]


def solve(task):
    """Balls that grow until the speed is near that of the safety device, then as large as it permits; and back."""
    exchanges, kg, way, gained, number = [], FIRST_KG, 0.0, 0.0, 0
    while number < STEPS and way < LAST:
        count = 1 if number < SINGLY or WIDEST - way < 3.5 * gained else 2
        calls = []
        for other in range(number, number + count - 1):
            calls += [*_ball(other, kg), *_rest()]
        calls += [*_ball(number + count - 1, kg), *_look(), *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        number += count
        gained, way = (readings[-1]["angle"] - way) / count, readings[-1]["angle"]
        most = 0.82 * FASTEST / max(readings[-3]["angular_velocity"], 0.001)
        kg *= min(8.0, most, 0.9 * max(WIDEST - way, 0.0) / max(gained, 1e-3))
    calls = [item for other in range(number - 1, max(number - 1 - BACK, 0), -1) for item in _back(other)]
    exchanges += zip(calls, (yield calls), strict=True)
    yield [answer(_best(_rows_of(exchanges)))]


def stage(task):
    """Ask for a ball that is heavy enough for any strength, and read where it comes to rest."""
    readings = yield [*_ball(0, 200.0, 0.3), *_rest(), call("step", duration=5), call("get_position", object_id=WHEEL)]
    yield [answer(200.0 * ASKED / max(readings[-1]["angle"], 1e-3))]


def batch(task):
    """Eleven balls, most of them of the same mass, joined and taken away again, and the best fit."""
    calls = []
    for number in range(11):
        calls += [*_ball(number, min(0.02 * 1.8**number, 0.35)), *_rest()]
    for number in range(10, 5, -1):
        calls += _back(number)
    readings = yield calls
    rows = _rows_of(zip(calls, readings, strict=True))
    yield [answer(_best(rows) if len(rows) > 1 else 1.0)]


def structure(knobs):
    """Which parts there are."""
    return knobs["kind"]


def _drawn(knobs):
    count = len(KINDS[knobs["kind"]])
    strengths = [knobs["scale"], knobs["k1"], knobs["k2"]][: 1 + count]
    return strengths, (knobs["early"], knobs["late"])[:count]


def naive(knobs):
    """The same way back as out; the greatest load within reach in proportion to the angle."""
    strengths, bends = _drawn(knobs)
    near, same = (_table([0.39, ASKED], "W" * len(bends), bends) @ np.array(strengths)).tolist()
    return {
        "same way back": same / (GRAVITY * LEVER * cos(ASKED)),
        "in proportion": near / (GRAVITY * LEVER * cos(0.39)) * ASKED / 0.39,
    }


def theory(knobs):
    """Balance of torques on the way back."""
    return _load(knobs["kind"], *_drawn(knobs))


def measure(engine, knobs):
    """The torque that holds the engine's wheel at the asked angle on the way back, without the safety device."""
    engine = engine.changed({"joint[device_joint].damping": 1e6})
    stiff, tick, goal, way = 60 * knobs["scale"], 1 / engine.whole_steps(1.0), 0.0, 1
    while True:
        turn, spin = engine.pose(WHEEL).quaternion, float(engine.twist(WHEEL).angular[1])
        angle = 2 * float(np.arctan2(turn[2], turn[0]))
        torque = stiff * (goal - angle)
        if way == 1 and angle >= FARTHEST:
            way = -1
        elif way == -1 and angle <= ASKED:
            return (torque - knobs["oil"] * spin) / (GRAVITY * LEVER * cos(ASKED))
        left = FARTHEST - angle if way == 1 else angle - ASKED
        goal += way * tick * (0.3 if left > 0.05 else 0.008)
        engine.push(WHEEL, torque=np.array([0.0, torque, 0.0]))
        engine.step(1)
