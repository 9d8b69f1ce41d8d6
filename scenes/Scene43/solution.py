"""Scene 43: turn the rocker with small balls, load its axle with heavy ones, and see how far they turn it back."""

import numpy as np
from scipy.optimize import least_squares

from scenes.courses import accepted
from scenes.family import member
from scenes.loads import GRAVITY, Lever, ball, joined, mass_of
from scenes.protocol import answer

FAR_KG, FAR = 300.0, 0.8
LEVER = Lever(
    widest=0.4,
    enough=0.37,
    fastest=0.042,
    share=0.72,
    room=3.5,
    first_kg=0.001,
    most=21,
    singly=5,
    look_s=0.12,
    apart_m=0.06,
    name="side",
)
SIGMA = 1e-3
"""Standard deviation of an angle that is read, rad."""
CENTRAL_KG, ENOUGH_KG, HEAVIEST_KG = 0.8, 60.0, 11.0
CALLS = 148
POWERS = {"no cam": 0, "square": 2, "fourth power": 4}
TOLD_KG, TOLD, SHARE = 40.0, 0.4, (0.2, 1.3)
"""Load and angle for which the cam's torque is told, and the range of this torque over that of the wire."""


def _terms(balls, angle, power):
    """Torque of the loads, and of a cam of unit strength; a ball is kg, x, angle when joined."""
    load = cam = 0.0
    for kg, x, start in balls:
        load += GRAVITY * kg * x * np.cos(angle - start)
        if power:  # a ball is joined at the height at which the axle was at the start: below the lifted axle
            cam += GRAVITY * kg * (power * angle ** (power - 1) + start**power * np.sin(angle - start))
    return load, cam


def _strengths(constants, power):
    """Strengths of wire and cam from the logarithm of the one and the told share of the other."""
    wire = float(np.exp(constants[0]))
    return wire, constants[1] * wire * TOLD / (TOLD_KG * GRAVITY * power * TOLD ** (power - 1)) if power else 0.0


def _torque(kind, wire, cam):
    """The asked torque."""
    power = POWERS[kind]
    return float(wire * FAR + (FAR_KG * GRAVITY * cam * power * FAR ** (power - 1) if power else 0.0))


def _member(states, kind):
    """One kind of cam, fitted to the angles."""
    power = POWERS[kind]
    angles = np.array([angle for _, angle in states])
    here, ahead = (np.array([_terms(balls, angle + more, power) for balls, angle in states]).T for more in (0.0, 1e-4))

    def misfits(constants):
        wire, cam = _strengths(constants, power)
        off = wire * angles + cam * here[1] - here[0]
        slope = wire + (cam * (ahead[1] - here[1]) - (ahead[0] - here[0])) / 1e-4
        return off / (SIGMA * np.maximum(slope, 0.3 * wire) + 5e-4 * np.abs(here[0]))

    middle = float(np.log(np.max(here[0]) / np.max(angles)))
    ranges = [(middle - 2.0, middle + 2.0), SHARE][: 2 if power else 1]
    bounds = tuple(zip(*ranges, strict=True))
    starts = [[middle, share][: len(ranges)] for share in (0.3, 0.6, 1.0)]
    best = min((least_squares(misfits, start, bounds=bounds) for start in starts), key=lambda found: found.cost)
    return member(misfits, lambda constants: _torque(kind, *_strengths(constants, power)), best.x, ranges)


def rivals(readings):
    """Every kind of cam, fitted."""
    states = _states(readings)
    return {kind: _member(states, kind) for kind in POWERS}


def _best(states):
    """The asked torque by the simplest cam that fits."""
    found = [_member(states, kind) for kind in POWERS]
    return min(found, key=lambda fit: fit.chi_square + 8 * fit.constants).answer


def fit(readings, structure):
    """The asked torque by one kind of cam."""
    return _member(_states(readings), structure).answer


def _states(exchanges):
    """The balls and the angle wherever the rocker was at rest within the range."""
    balls, angle, made, states, last = [], 0.0, {}, [], 0.0
    for asked, reading in accepted(exchanges):
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = (mass_of(asked), asked.arguments["pos"][0])
        elif asked.tool == "attach_objects":
            balls = [*balls, (*made[asked.arguments["object1_id"]], angle)]
        elif asked.tool == "step":
            last = asked.arguments["duration"]
        elif asked.tool == "get_position":
            angle = reading["angle"]
            if abs(angle) > LEVER.widest:
                break
            if last > 1.0:
                states.append((balls, angle))
    return states


def _on_axle(number, kg):
    """A ball on the line of the axle."""
    side = 1 if number % 2 else -1
    return joined(ball(f"axle{number}", kg, [0.0, side * (0.12 + 0.12 * (number // 2)), 1.0], 0.03), LEVER.body)


def solve(task):
    """Balls on the side that grow as the speed permits, then balls on the axle in the same way."""
    seen, _ = yield from LEVER.turned()
    kg, loaded = CENTRAL_KG, 0.0
    for number in range(5):
        pair = [number] if number < 2 else [2 * number - 2, 2 * number - 1]
        calls = [*_on_axle(pair[0], kg), *LEVER.look(), *LEVER.rest()]
        calls += [item for other in pair[1:] for item in [*_on_axle(other, kg), *LEVER.rest()]]
        if len(seen) + len(calls) > CALLS:
            break
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        loaded += kg * len(pair)
        kg *= min(3.5, 0.7 * LEVER.fastest / max(-readings[3]["angular_velocity"], 0.001))
        kg = min(kg, HEAVIEST_KG, (ENOUGH_KG - loaded) / 2)
    yield [answer(_best(_states(seen)))]


def stage(task):
    """Ask for the whole load, and for a ball on the side that holds it."""
    load = joined(ball("load", FAR_KG, [0.0, 0.2, 1.0], 0.3), LEVER.body)
    readings = yield [*load, *LEVER.ball(0, FAR_KG, 0.3), *LEVER.rest()]
    yield [answer(readings[-1].get("angle", 1.0))]


def batch(task):
    """Balls of about the same mass on the side, then balls on the axle, and the best fit."""
    calls = []
    for number in range(10):
        calls += [*LEVER.ball(number, min(0.004 * 1.7**number, 0.03)), *LEVER.rest()]
    for number in range(5):
        calls += [*_on_axle(number, min(0.8 * 2**number, HEAVIEST_KG)), *LEVER.rest()]
    states = _states(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(states) if len(states) > 2 else 1.0)]


def _cam(knobs):
    return knobs["c2"] + knobs["c4"]


def naive(knobs):
    """The wire alone; the torque under 40 kg at 0.38 rad in proportion to the angle."""
    power = POWERS[knobs["kind"]]
    lifted = TOLD_KG * GRAVITY * _cam(knobs) * power * 0.38 ** (power - 1) if power else 0.0
    return {"wire alone": knobs["scale"] * FAR, "in proportion": (knobs["scale"] * 0.38 + lifted) * FAR / 0.38}


def theory(knobs):
    """Torque of the wire, and the weight's work over the angle."""
    return _torque(knobs["kind"], knobs["scale"], _cam(knobs))


def measure(engine, knobs):
    """The torque that holds the engine's rocker under the weight of the load, without the safety device."""
    engine = engine.changed({"joint[device_joint].damping": 1e6})
    stiff, tick, goal = 60 * knobs["scale"], 1 / engine.whole_steps(1.0), 0.0
    while True:
        rocker = engine.turn(LEVER.body)
        torque = stiff * (goal - rocker.angle)
        if rocker.angle >= FAR:
            return torque - knobs["oil"] * rocker.spin
        goal += tick * (0.3 if FAR - rocker.angle > 0.05 else 0.02)
        engine.push(LEVER.body, force=np.array([0.0, 0.0, -GRAVITY * FAR_KG]), torque=np.array([0.0, torque, 0.0]))
        engine.step(1)


def settles(engine, knobs, off):
    """Where the rocker ends under load and torque if it begins near the asked angle."""
    free, power = engine.changed({"joint[device_joint].damping": 1e6}), POWERS[knobs["kind"]]
    for angle in (FAR * (1 + off), FAR):
        torque = knobs["scale"] * angle
        if power:
            torque += FAR_KG * GRAVITY * _cam(knobs) * power * angle ** (power - 1)
        free.push(LEVER.body, force=np.array([0.0, 0.0, -GRAVITY * FAR_KG]), torque=np.array([0.0, torque, 0.0]))
        free.step(free.whole_steps(30.0))
    return float(free.turn(LEVER.body).angle) / FAR - 1
