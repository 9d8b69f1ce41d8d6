"""Scene 42: load the beam step by step below the speed of the safety device, decide what turns it back, carry it on."""

from math import cos, pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
BEAM, LEVER, FAR = "object_1", 0.5, 1.05
HEIGHT = 1.0
FASTEST, STEEPEST = 0.034, 0.4
RESOLUTION = 4e-3
FIRST_KG = 0.002
LOOK_S, WAIT_S = 0.05, 6.0
STEPS, SINGLY, LAST = 26, 5, 0.38
"""Most balls; how many of them are joined one by one, the others two at a time; and the angle that is enough."""
RADIUS = 0.02
KINDS = {"weight": 1, "wire": 1, "leaves": 2, "weight and leaves": 2, "clamps": 3}
"""How many numbers describe each kind of restoring torque."""
SLIPS = np.arange(0.04, 0.3, 0.004)


def _columns(kind, angle, slip):
    """Torques of unit strength at the angles."""
    angle = np.asarray(angle, dtype=float)
    main = np.sin(angle) if "weight" in kind else angle
    if "leaves" in kind:
        return np.column_stack([main, angle**3])
    if kind == "clamps":
        return np.column_stack([main, np.clip(angle, -slip, slip)])
    return main[:, None]


def _fitted(rows, kind):
    """Misfit in units of the resolution, and strengths and slip of one kind of restoring torque."""
    loads, angles = np.array(rows).T
    best = None
    for slip in SLIPS if kind == "clamps" else (1.0,):
        table, ahead = _columns(kind, angles, slip), _columns(kind, angles + 1e-3, slip)
        slope = np.full(len(angles), np.max(loads / np.maximum(angles, 0.01)))
        for _ in range(3):
            error = 0.4 * RESOLUTION * slope
            strengths, *_ = np.linalg.lstsq(table / error[:, None], loads / error, rcond=None)
            slope = np.maximum((ahead - table) @ strengths / 1e-3, 0.05 * np.max(slope))
        misfit = float(np.sum(((table @ strengths - loads) / (0.4 * RESOLUTION * slope)) ** 2))
        misfit += 1e4 * (float(np.min(strengths)) < 0)
        if best is None or misfit < best[0]:
            best = (misfit, strengths, slip)
    return best


def _mass(kind, strengths, slip):
    """The asked mass."""
    torque = (_columns(kind, [FAR], slip) @ np.asarray(strengths)).item()
    return torque / (GRAVITY * LEVER * cos(FAR))


def _best(rows):
    """The simplest kind that fits, as its mass."""
    found = {kind: _fitted(rows, kind) for kind in KINDS}
    best = min(KINDS, key=lambda kind: found[kind][0] + 4 * KINDS[kind])
    return _mass(best, *found[best][1:])


def _rows_of(exchanges):
    """Load torque and angle wherever the beam was at rest within the range."""
    balls, angle, made, rows, last = [], 0.0, {}, [], 0.0
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            balls.append((made[asked.arguments["object1_id"]], angle))
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position":
            angle = reading["angle"]
            if abs(angle) > STEEPEST:
                break
            if last > 1.0:
                rows.append((sum(kg * GRAVITY * LEVER * cos(angle - start) for kg, start in balls), angle))
    return rows


def fit(readings, structure):
    """The asked mass by one kind of restoring torque."""
    return _mass(structure, *_fitted(_rows_of(readings), structure)[1:])


def _ball(number, kg, radius=RADIUS):
    """A ball at the height of the axis, 0.5 m to the right; its place across the beam does not matter."""
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
        call("attach_objects", object1_id=name, object2_id=BEAM),
    ]


def _look():
    return [call("step", duration=LOOK_S), call("get_velocity", object_id=BEAM)]


def _rest():
    return [call("step", duration=WAIT_S), call("get_position", object_id=BEAM)]


def solve(task):
    """Balls that grow until the speed is near that of the safety device, then as large as it permits."""
    exchanges, kg, way, gained, number = [], FIRST_KG, 0.0, 0.0, 0
    while number < STEPS and way < LAST:
        count = 1 if number < SINGLY or STEEPEST - way < 2.5 * gained else 2
        calls = []
        for other in range(number, number + count - 1):
            calls += [*_ball(other, kg), *_rest()]
        calls += [*_ball(number + count - 1, kg), *_look(), *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        number += count
        gained, way = (readings[-1]["angle"] - way) / count, readings[-1]["angle"]
        most = 0.82 * FASTEST / max(readings[-3]["angular_velocity"], 0.001)
        kg *= min(8.0, most, 0.9 * max(STEEPEST - way, 0.0) / max(gained, 1e-3))
    yield [answer(_best(_rows_of(exchanges)))]


def stage(task):
    """Ask for a ball that is heavy enough for any strength, and read where it comes to rest."""
    readings = yield [*_ball(0, 500.0, 0.3), *_rest(), call("step", duration=5), call("get_position", object_id=BEAM)]
    angle = max(readings[-1]["angle"], 1e-3)
    yield [answer(500.0 * FAR / angle)]


def batch(task):
    """Fifteen balls of about the same mass, after a few smaller ones, and the best fit."""
    calls = []
    for number in range(15):
        calls += [*_ball(number, min(0.02 * 1.5**number, 0.2)), *_rest()]
    readings = yield calls
    rows = _rows_of(zip(calls, readings, strict=True))
    yield [answer(_best(rows) if len(rows) > 1 else 1.0)]


def structure(knobs):
    """What turns the beam back."""
    return knobs["kind"]


def _strengths(knobs):
    main = knobs["hang"] + knobs["wire"]
    more = {"leaves": [knobs["leaf"]], "weight and leaves": [knobs["leaf"]], "clamps": [knobs["clamp"]]}
    return [main, *more.get(knobs["kind"], [])]


def naive(knobs):
    """The last load in proportion to the angle; the first slope with the lever of the load."""
    kind, slip = knobs["kind"], knobs["slip"]
    at = (_columns(kind, [0.01, 0.38], slip) @ np.array(_strengths(knobs))).tolist()
    return {
        "in proportion": at[1] / (GRAVITY * LEVER * cos(0.38)) * FAR / 0.38,
        "first slope": at[0] / 0.01 * FAR / (GRAVITY * LEVER * cos(FAR)),
    }


def theory(knobs):
    """Balance of torques."""
    return _mass(knobs["kind"], _strengths(knobs), knobs["slip"])


def measure(engine, knobs):
    """The torque that holds the engine's beam at the asked angle, without the safety device."""
    engine = engine.changed({"joint[brake_joint].damping": 1e6})
    stiff, held, tick = 20 * knobs["scale"], 0.0, 1 / engine.whole_steps(1.0)
    while True:
        turn, spin = engine.pose(BEAM).quaternion, float(engine.twist(BEAM).angular[1])
        angle = 2 * float(np.arctan2(turn[2], turn[0]))
        if abs(FAR - angle) < 1e-5 and abs(spin) < 1e-5:
            break
        held += 40 * knobs["scale"] * tick * (FAR - angle)
        torque = stiff * (FAR - angle) + held
        engine.push(BEAM, torque=np.array([0.0, torque, 0.0]))
        engine.step(1)
    return torque / (GRAVITY * LEVER * cos(FAR))
