"""Scene 43: turn the rocker with small balls, load its axle with heavy ones, and see how far they turn it back."""

from math import pi

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
ROCKER, LEVER, HEIGHT = "object_1", 0.5, 1.0
FAR_KG, FAR = 300.0, 0.8
FASTEST, WIDEST = 0.05, 0.4
SIGMA = 7e-4
FIRST_KG, CENTRAL_KG, ENOUGH_KG = 0.001, 0.8, 48.0
LOOK_S, WAIT_S = 0.12, 6.0
STEPS, SINGLY, LAST = 21, 5, 0.36
"""Most balls on the side; how many are joined one by one, the others two at a time; and the angle that is enough."""
CENTRALS, HEAVIEST_KG = 6, 11.0
SMALL, LARGE = 0.02, 0.03
"""Radii of the balls on the side and on the axle, m."""
POWERS = {"no cam": 0, "square": 2, "fourth power": 4}


def _terms(balls, angle, power):
    """Torque of the loads, and the torque of wire and cam of unit strength; a ball is kg, x, angle when joined."""
    load = cam = 0.0
    for kg, x, start in balls:
        load += GRAVITY * kg * x * np.cos(angle - start)
        if power:  # a ball is joined at the height at which the axle was at the start: below the lifted axle
            cam += GRAVITY * kg * (power * angle ** (power - 1) + start**power * np.sin(angle - start))
    return load, angle, cam


def _fitted(states, kind):
    """Misfit in units of the resolution, strength of the wire and of the cam."""
    power = POWERS[kind]
    table = np.array([_terms(balls, angle, power) for balls, angle in states])
    load, columns = table[:, 0], table[:, 1:] if power else table[:, 1:2]
    ahead = np.array([_terms(balls, angle + 1e-4, power) for balls, angle in states])
    slope = np.full(len(load), float(np.max(load) / np.max(table[:, 1])))
    strengths = np.zeros(columns.shape[1])
    for _ in range(3):
        error = SIGMA * slope + 1e-3 * np.abs(load)
        strengths, *_ = np.linalg.lstsq(columns / error[:, None], load / error, rcond=None)
        change = (ahead - table)[:, 1 : 1 + len(strengths)] @ strengths - (ahead - table)[:, 0]
        slope = np.maximum(change / 1e-4, 0.3 * abs(strengths[0]))
    misfit = float(np.sum(((columns @ strengths - load) / error) ** 2)) + 1e4 * float(np.min(strengths) < 0)
    return misfit, float(strengths[0]), float(strengths[1]) if power else 0.0


def _torque(kind, wire, cam):
    """The asked torque."""
    power = POWERS[kind]
    return wire * FAR + (FAR_KG * GRAVITY * cam * power * FAR ** (power - 1) if power else 0.0)


def _best(states):
    """The asked torque by the simplest cam that fits."""
    found = {kind: _fitted(states, kind) for kind in POWERS}
    kind = min(POWERS, key=lambda kind: found[kind][0] + 8 * (POWERS[kind] > 0))
    return _torque(kind, *found[kind][1:])


def _states_of(exchanges):
    """The balls and the angle wherever the rocker was at rest within the range."""
    balls, angle, made, states, last = [], 0.0, {}, [], 0.0
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            kg = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
            made[asked.arguments["name"]] = (kg, asked.arguments["pos"][0])
        elif asked.tool == "attach_objects":
            balls = [*balls, (*made[asked.arguments["object1_id"]], angle)]
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position":
            angle = reading["angle"]
            if abs(angle) > WIDEST:
                break
            if last > 1.0:
                states.append((balls, angle))
    return states


def fit(readings, structure):
    """The asked torque by one kind of cam."""
    return _torque(structure, *_fitted(_states_of(readings), structure)[1:])


def _ball(name, kg, x, y, radius):
    return [
        call(
            "create_objects",
            name=name,
            pos=[x, y, HEIGHT],
            density=kg / (4 / 3 * pi * radius**3),
            rgba=[1, 0, 0, 1],
            radius=radius,
        ),
        call("attach_objects", object1_id=name, object2_id=ROCKER),
    ]


def _on_side(number, kg):
    """A small ball 0.5 m to the right; its place along the axle does not matter."""
    side = 1 if number % 2 else -1
    return _ball(f"side{number}", kg, LEVER, side * (0.1 + 0.06 * (number // 2)), SMALL)


def _on_axle(number, kg):
    """A ball on the line of the axle."""
    side = 1 if number % 2 else -1
    return _ball(f"axle{number}", kg, 0.0, side * (0.12 + 0.12 * (number // 2)), LARGE)


def _look():
    return [call("step", duration=LOOK_S), call("get_velocity", object_id=ROCKER)]


def _rest():
    return [call("step", duration=WAIT_S), call("get_position", object_id=ROCKER)]


def solve(task):
    """Balls on the side that grow as the speed permits, then balls on the axle in the same way."""
    exchanges, kg, way, gained, number = [], FIRST_KG, 0.0, 0.0, 0
    while number < STEPS and way < LAST:
        count = 1 if number < SINGLY or WIDEST - way < 3.5 * gained else 2
        calls = []
        for other in range(number, number + count - 1):
            calls += [*_on_side(other, kg), *_rest()]
        calls += [*_on_side(number + count - 1, kg), *_look(), *_rest()]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        number += count
        gained, way = (readings[-1]["angle"] - way) / count, readings[-1]["angle"]
        most = 0.75 * FASTEST / max(readings[-3]["angular_velocity"], 0.001)
        kg *= min(8.0, most, 0.9 * max(WIDEST - way, 0.0) / max(gained, 1e-3))
    kg, loaded = CENTRAL_KG, 0.0
    for number in range(CENTRALS - 2):
        pair = [number] if number < 2 else [2 * number - 2, 2 * number - 1]
        calls = [item for other in pair for item in [*_on_axle(other, kg), *_look(), *_rest()]]
        readings = yield calls
        exchanges += zip(calls, readings, strict=True)
        loaded += kg * len(pair)
        kg *= min(3.5, 0.7 * FASTEST / max(-readings[3]["angular_velocity"], 0.001))
        kg = min(kg, HEAVIEST_KG, (ENOUGH_KG - loaded) / 2)
    yield [answer(_best(_states_of(exchanges)))]


def stage(task):
    """Ask for the whole load, and for a ball on the side that holds it."""
    readings = yield [*_ball("load", FAR_KG, 0.0, 0.2, 0.3), *_ball("side", FAR_KG, LEVER, 0.2, 0.3), *_rest()]
    yield [answer(readings[-1]["angle"])]


def batch(task):
    """Balls of about the same mass on the side, then balls on the axle, and the best fit."""
    calls = []
    for number in range(10):
        calls += [*_on_side(number, min(0.004 * 1.7**number, 0.03)), *_rest()]
    for number in range(5):
        calls += [*_on_axle(number, min(0.8 * 2**number, HEAVIEST_KG)), *_rest()]
    readings = yield calls
    states = _states_of(zip(calls, readings, strict=True))
    yield [answer(_best(states) if len(states) > 2 else 1.0)]


def structure(knobs):
    """How the cam's height depends on the angle."""
    return knobs["kind"]


def _cam(knobs):
    return knobs["c2"] + knobs["c4"]


def naive(knobs):
    """The wire alone; the torque under 40 kg at 0.38 rad in proportion to the angle."""
    power = POWERS[knobs["kind"]]
    lifted = 40 * GRAVITY * _cam(knobs) * power * 0.38 ** (power - 1) if power else 0.0
    return {"wire alone": knobs["scale"] * FAR, "in proportion": (knobs["scale"] * 0.38 + lifted) * FAR / 0.38}


def theory(knobs):
    """Torque of the wire, and the weight's work over the angle."""
    return _torque(knobs["kind"], knobs["scale"], _cam(knobs))


def measure(engine, knobs):
    """The torque that holds the engine's rocker under the weight of the load, without the safety device."""
    engine = engine.changed({"joint[device_joint].damping": 1e6})
    stiff, tick, goal = 60 * knobs["scale"], 1 / engine.whole_steps(1.0), 0.0
    while True:
        turn, spin = engine.pose(ROCKER).quaternion, float(engine.twist(ROCKER).angular[1])
        angle = 2 * float(np.arctan2(turn[2], turn[0]))
        torque = stiff * (goal - angle)
        if angle >= FAR:
            return torque - knobs["oil"] * spin
        goal += tick * (0.3 if FAR - angle > 0.05 else 0.02)
        engine.push(ROCKER, force=np.array([0.0, 0.0, -GRAVITY * FAR_KG]), torque=np.array([0.0, torque, 0.0]))
        engine.step(1)
