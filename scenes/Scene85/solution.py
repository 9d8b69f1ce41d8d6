"""Scene 85: weigh the wheel with a weak torque, drive it to and fro until the brake is used, fit each brake."""

from itertools import product

import numpy as np
from scipy.integrate import quad

from scenes.courses import Channel, Laws
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

FULL_RAD_S, SLOW_RAD_S = 80.0, 10.0
GREATEST_NM, GREATEST_RAD_S2 = 8.0, 30.0
EDGE_RAD, EDGE_RAD_S, SHORTEST_S, LONGEST_S, MOMENT_S, RECENT = 53.0, 46.0, 0.15, 2.2, 0.025, 15
GUARD_RAD, GUARD_RAD_S = 60.0, 50.0
LEGS, LOOKS, CALLS = 13, 3, 150
CREEP_RAD_S = 0.5
"""Spin below which the dry part of the brake fades."""
LAG_S = 0.0025
"""Delay with which the laboratory's brake follows the heat."""
BRAKES = {"eddy": "r", "shoes": "s"}
USES = {"weakens": -1, "bites": 1}


def _fresh(law, knobs, spin):
    """Torque of the unused brake over the moment of inertia."""
    grows = knobs["r"] if law == "eddy" else knobs["s"] * abs(spin)
    return knobs["a"] * np.tanh(spin / CREEP_RAD_S) + grows * spin


def _rates(structure, knobs, time, state, torque):
    """Time derivative of angle, spin, and heat over inertia."""
    _, spin, heat = state
    law, use = structure.split(", ")
    brake = _fresh(law, knobs, spin)
    for lag in (0.0, LAG_S):
        heated = np.maximum(heat - lag * brake * spin, 0.0)
        brake = _fresh(law, knobs, spin) * (1 + heated / knobs["e"]) ** USES[use]
    return np.array([spin, torque[0] / knobs["i"] - brake, brake * spin])


def _laws(longest_s):
    """The laws, integrated in steps of a length."""
    return Laws(
        rates=_rates,
        structures={f"{law}, {use}": ("i", "a", BRAKES[law], "e") for law, use in product(BRAKES, USES)},
        box={"i": (0.000001, 0.4), "a": (0.3, 8), "r": (0.02, 1.2), "s": (0.001, 0.05), "e": (300, 10000)},
        start=(0.0, 0.0, 0.0),
        sigma=(0.03, 0.04),
        longest_s=longest_s,
        starts=60,
        tried=2,
        rounds=12,
    )


LAWS, FINE = _laws(0.15), _laws(0.03)
"""Long steps tell the laws apart; the constants need short ones, since the dry part changes within a moment."""


RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 2)],
    [Channel("get_position", "object_1", "angle"), Channel("get_velocity", "object_1", "angular_velocity")],
    decimals=8,
)


def _course(readings):
    """The course up to where the guard acted."""
    course = RIG.course(readings)
    angles, spins = abs(course.readings.T)
    kept = course.until((angles > GUARD_RAD) | (spins > GUARD_RAD_S))
    return kept if kept.count else course


def _run_down(structure, knobs):
    """Angle until rest, and time until the slow spin, from integrals over the spin."""
    law, use = structure.split(", ")

    def lasts(spin):
        used = 1 + (FULL_RAD_S**2 - spin**2) / 2 / knobs["e"]
        return 1 / used ** USES[use] / _fresh(law, knobs, spin)

    bends = [0.5, 2.0, 10.0, 40.0]
    angle = quad(lambda spin: spin * lasts(spin), 1e-9, FULL_RAD_S, points=bends, limit=200)[0]
    return [float(angle), float(quad(lasts, SLOW_RAD_S, FULL_RAD_S, limit=200)[0])]


def structure(knobs):
    """How the brake follows the spin, and how use changes it."""
    return f"{knobs['law']}, {knobs['use']}"


def fit(readings, structure):
    """The run-down by the best fit of a structure."""
    return _run_down(structure, FINE.fitted(_course(readings), structure)[1])


def _found(readings):
    """The run-down by the structure that fits best."""
    return fit(readings, LAWS.best(_course(readings))[0])


def theory(knobs):
    """The run-down from the drawn law."""
    return _run_down(structure(knobs), knobs)


def rivals(readings):
    """Each brake, fitted."""
    return members(LAWS, _course(readings), _run_down)


def naive(knobs):
    """A brake that lasts; one that follows the other law, alike at 20 rad/s; the dry part alone."""
    law = "shoes" if knobs["law"] == "eddy" else "eddy"
    other = {**knobs, "r": 20.0 * knobs["s"], "s": knobs["r"] / 20.0}
    return {
        "the brake lasts": _run_down(structure(knobs), {**knobs, "e": 1e9}),
        "other law": _run_down(f"{law}, {knobs['use']}", other),
        "dry friction": _run_down("eddy, weakens", {**knobs, "r": 1e-6, "e": 1e9}),
    }


def _roughly(course):
    """Inertia, and dry and growing part of the brake over it, of the last looks, by linear least squares."""
    angles, spins = np.insert(course.readings, 0, 0.0, axis=0).T
    before, after, times = spins[:-1], spins[1:], course.durations
    rows = [course.controls[:, 0] * times, -np.tanh(before + after) * times, -np.diff(angles)]
    parts = np.linalg.lstsq(np.column_stack(rows)[-RECENT:], (after - before)[-RECENT:], rcond=None)[0]
    return (
        1 / float(np.clip(parts[0], 2.0, 1e6)),
        float(np.clip(parts[1], 0.0, 10.0)),
        float(np.clip(parts[2], 0.0, 1.5)),
    )


def _moved(angle, spin, acceleration, brake):
    """Angle and spin a moment later."""
    spin += MOMENT_S * (acceleration - brake[0] * np.tanh(2 * spin) - brake[1] * spin)
    return angle + MOMENT_S * spin, spin


def _lasts(angle, spin, acceleration, brake):
    """How long a torque may act until the wheel could not be kept from the guard any more."""
    time = 0.0
    while time < LONGEST_S:
        angle, spin = _moved(angle, spin, acceleration, brake)
        place, speed = angle, spin
        while speed * acceleration > 0:
            place, speed = _moved(place, speed, -0.85 * acceleration, (0.0, brake[1] / 4))
        if np.sign(acceleration) * place > EDGE_RAD or np.sign(acceleration) * spin > EDGE_RAD_S:
            break
        time += MOMENT_S
    return time


def solve(task):
    """Torques that grow until the wheel turns visibly; then to and fro, always short of the guard."""
    seen, strength = [], 0.0005
    while True:
        calls = RIG.leg(strength, 0.15)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        spin, before = readings[-1]["angular_velocity"], seen[-5][1]["angular_velocity"] if len(seen) > 4 else 0.0
        if spin - before > 0.7 or strength >= GREATEST_NM:
            break
        strength = min(8 * strength, GREATEST_NM)
    inertia, brake, sense = strength * 0.15 / max(spin - before, 0.1), (0.0, 0.0), -1.0
    for leg in range(LEGS):
        greatest = min(0.95 * GREATEST_NM / inertia, GREATEST_RAD_S2)
        duration = _lasts(readings[-2]["angle"], spin, sense * greatest, brake)
        if duration < SHORTEST_S:
            sense = -sense
            duration = _lasts(readings[-2]["angle"], spin, sense * greatest, brake)
        calls = RIG.leg(sense * greatest * inertia, 0.4 if leg < 1 else max(duration, SHORTEST_S), LOOKS)
        if len(seen) + len(calls) > CALLS:
            break
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        spin = readings[-1]["angular_velocity"]
        inertia, *found = _roughly(_course(seen))
        brake = found if leg > 2 else brake
    yield [answer(_found(seen))]


PULSES = ((0.0005, 1.0), (-0.002, 1.0), (0.008, 1.0), (-0.03, 1.0), (0.12, 1.0), (-0.5, 1.0), (2.0, 1.0), (-8.0, 1.0))


def batch(task):
    """Torques to and fro, ever stronger, and the same fit up to where the guard may have caught."""
    calls = [asked for strength, duration in PULSES for asked in RIG.leg(strength, duration, 2)]
    readings = yield calls
    yield [answer(_found(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Turn it up as far as one can; the guard catches it."""
    readings = yield [*RIG.leg(GREATEST_NM, 1.5), *RIG.leg(0.0, 30.0)]
    yield [answer([abs(readings[-2]["angle"]), 31.0])]


def measure(engine, knobs):
    """The run-down in the engine, without the guard."""
    free = engine.changed({"body[guard].pos": (1e6, 1e6, 0.0), "joint[object_1_joint].range": (-1e6, 1e6)})
    step = 1 / free.whole_steps(1.0)
    for brake in (0.0, float(_fresh(knobs["law"], knobs, FULL_RAD_S))):
        wanted = (FULL_RAD_S - float(free.twist("object_1").angular[2])) / step + brake
        free.push("object_1", torque=np.array([0.0, 0.0, knobs["i"] * wanted]))
        free.step(1)
    free.push("object_1", torque=np.zeros(3))
    free.place("heat", np.zeros(3), {})
    angle, time, fallen, spin = 0.0, 0.0, None, float(free.twist("object_1").angular[2])
    while spin > 0.01 and time < 200:
        free.step(1)
        last, spin, time = spin, float(free.twist("object_1").angular[2]), time + step
        angle += (last + spin) / 2 * step
        if fallen is None and spin < SLOW_RAD_S:
            fallen = time - step * (SLOW_RAD_S - spin) / (last - spin)
    return [angle, fallen]
