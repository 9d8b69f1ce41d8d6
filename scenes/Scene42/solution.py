"""Scene 42: load the beam step by step below the speed of the safety device, decide what turns it back, carry it on."""

from math import cos, pi

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.loads import GRAVITY, Lever
from scenes.protocol import answer

FAR = 1.05
LEVER = Lever(
    widest=0.4,
    enough=0.38,
    fastest=0.034,
    share=0.8,
    room=2.5,
    first_kg=0.002,
    most=26,
    singly=5,
    look_s=0.05,
)
SIGMA = 1e-3
"""Standard deviation of an angle that is read, rad."""
KINDS = {
    "weight": (),
    "wire": (),
    "leaves": ((0.15, 0.8),),
    "weight and leaves": ((0.15, 0.8),),
    "clamps": ((0.5, 2.0), (0.06, 0.25)),
}
"""Ranges of the further constants: share of the leaves at TOLD; stiffness of clamps over the wire's, angle of slip."""
TOLD = 0.4


def _torque(kind, angle, strengths):
    """Torque from the strength of weight or wire, then that of leaves, or of clamps and their angle of slip."""
    main = strengths[0] * (np.sin(angle) if "weight" in kind else angle)
    if "leaves" in kind:
        return main + strengths[1] * angle**3
    return main + (strengths[1] * np.clip(angle, -strengths[2], strengths[2]) if kind == "clamps" else 0.0)


def _strengths(kind, constants):
    """Strengths from the logarithm of the torque at TOLD, and the further constants."""
    torque, *more = np.exp(constants[0]), *constants[1:]
    if kind == "clamps":
        wire = torque / _torque(kind, TOLD, (1.0, *more))
        return wire, wire * more[0], more[1]
    share = more[0] if more else 0.0
    main = torque * (1 - share) / _torque(kind, TOLD, (1.0, 0.0))
    return (main, torque * share / TOLD**3) if more else (main,)


def _mass(kind, strengths):
    """The asked mass."""
    return float(_torque(kind, FAR, strengths) / (GRAVITY * LEVER.arm_m * cos(FAR)))


def _member(rows, kind):
    """One kind of restoring torque, fitted to the angles."""
    loads, angles = np.array(rows).T

    def misfits(constants):
        law = _strengths(kind, constants)
        behind, here, ahead = (_torque(kind, angles + more, law) for more in (-SIGMA, 0.0, SIGMA))
        slope = (ahead - behind) / (2 * SIGMA)  # the lever of the load changes less
        return (here - loads) / np.hypot(SIGMA * slope, 5e-4 * loads)

    near = int(np.argmax(angles))
    middle = float(np.log(loads[near] * TOLD / angles[near]))
    ranges = [(middle - 1.5, middle + 1.5), *KINDS[kind]]
    low, high = np.array(ranges).T
    best = None
    for part in (0.1, 0.3, 0.5, 0.7, 0.9) if KINDS[kind] else (0.5,):
        found = least_squares(misfits, [middle, *(low + part * (high - low))[1:]], bounds=(low, high))
        best = found if best is None or found.cost < best.cost else best
    return member(misfits, lambda constants: _mass(kind, _strengths(kind, constants)), best.x, ranges)


def rivals(readings):
    """Every kind of restoring torque, fitted."""
    rows = LEVER.torques(readings)
    return {kind: _member(rows, kind) for kind in KINDS}


def _best(rows):
    """The asked mass by the simplest kind that fits."""
    found = [_member(rows, kind) for kind in KINDS]
    return min(found, key=lambda fit: fit.chi_square + 4 * fit.constants).answer


def fit(readings, structure):
    """The asked mass by one kind of restoring torque."""
    return _member(LEVER.torques(readings), structure).answer


def solve(task):
    """Balls that grow until the speed is near that of the safety device, then as large as it permits."""
    seen, _ = yield from LEVER.turned()
    yield [answer(_best(LEVER.torques(seen)))]


def stage(task):
    """Ask for a ball that is heavy enough for any strength, and read where it comes to rest."""
    readings = yield [*LEVER.ball(0, 500.0, 0.3), *LEVER.rest()]
    yield [answer(500.0 * FAR / max(readings[-1].get("angle", 0.0), 1e-3))]


def batch(task):
    """Fifteen balls of about the same mass, after a few smaller ones, and the best fit."""
    calls = []
    for number in range(15):
        calls += [*LEVER.ball(number, min(0.02 * 1.5**number, 0.2)), *LEVER.rest()]
    rows = LEVER.torques(list(zip(calls, (yield calls), strict=True)))
    yield [answer(_best(rows) if len(rows) > 1 else 1.0)]


def _drawn(knobs):
    """The drawn strengths."""
    return knobs["hang"] + knobs["wire"], knobs["leaf"] + knobs["clamp"], knobs["slip"]


def naive(knobs):
    """The last load in proportion to the angle; the first slope with the lever of the load."""
    near, first = (float(_torque(knobs["kind"], angle, _drawn(knobs))) for angle in (0.38, 0.01))
    return {
        "in proportion": near / (GRAVITY * LEVER.arm_m * cos(0.38)) * FAR / 0.38,
        "first slope": first / 0.01 * FAR / (GRAVITY * LEVER.arm_m * cos(FAR)),
    }


def theory(knobs):
    """Balance of torques."""
    return _mass(knobs["kind"], _drawn(knobs))


def measure(engine, knobs):
    """The torque that holds the engine's beam at the asked angle, without the safety device."""
    engine = engine.changed({"joint[brake_joint].damping": 1e6})
    stiff, held, tick = 20 * knobs["scale"], 0.0, 1 / engine.whole_steps(1.0)
    while True:
        beam = engine.turn(LEVER.body)
        if abs(FAR - beam.angle) < 1e-5 and abs(beam.spin) < 1e-5:
            break
        held += 40 * knobs["scale"] * tick * (FAR - beam.angle)
        torque = stiff * (FAR - beam.angle) + held
        engine.push(LEVER.body, torque=np.array([0.0, torque, 0.0]))
        engine.step(1)
    return torque / (GRAVITY * LEVER.arm_m * cos(FAR))


def settles(engine, knobs, off):
    """Where the beam ends under a ball of the asked mass if a torque held it near the asked angle before."""
    free = engine.changed({"joint[brake_joint].damping": 1e6})
    kg, angle = _mass(knobs["kind"], _drawn(knobs)), FAR * (1 + off)
    place, radius = np.array([LEVER.arm_m, 0.0, LEVER.height_m]), (kg / 1e4 / (4 / 3 * pi)) ** (1 / 3)
    free.add_ball("created:load", place, 1e4, radius, np.ones(4), {})
    free.join("created:load", LEVER.body, "weld")
    lever = GRAVITY * LEVER.arm_m * kg
    extra = float(_torque(knobs["kind"], angle, _drawn(knobs))) - lever * cos(angle)
    for torque in (extra, 0.0):
        free.push(LEVER.body, torque=np.array([0.0, torque, 0.0]))
        free.step(free.whole_steps(40.0))
    return float(free.turn(LEVER.body).angle) / FAR - 1
