"""Scene 41: drop ball after ball until one keeps exactly half of its energy at the bounce."""

from math import log, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.2
DENSITY = 200.0
LOW, HIGH = 0.12, 3.0
PROBES = 9
CONTACT_S = 0.2
"""Longer than the ball touches the plate, shorter than it touches the plate and flies on."""
SHARE = 0.5


def _wait(height):
    """From the release at a height to shortly after the bounce."""
    return sqrt(2 * height / GRAVITY) + CONTACT_S


def _drop(name, height):
    """Drop a ball and read its energies for 1 kg shortly after the bounce."""
    return [
        call(
            "create_objects", name=name, pos=[0, 0, RADIUS + height], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS
        ),
        call("step", duration=_wait(height)),
        call("get_kinetic_energy", object_id=name, mass=1.0),
        call("get_potential_energy", object_id=name, mass=1.0, gravity=GRAVITY),
        call("delete_objects", object_id=name),
    ]


def _share(energy, height):
    """Rebound height over drop height, from the energy per mass after the bounce."""
    return (energy / GRAVITY - RADIUS) / height


def solve(task):
    """Close in by false position on the logarithms of height and share; halve where that is slow."""
    low, high = log(LOW), log(HIGH)
    at_low = at_high = None
    for probe in range(PROBES):
        middle = (low + high) / 2
        if at_low is not None and at_high is not None and at_low - at_high < 1.0:
            middle = low + (high - low) * min(max(at_low / (at_low - at_high), 0.1), 0.9)
        height = float(np.exp(middle))
        readings = yield _drop(f"probe{probe}", height)
        excess = log(_share(readings[2]["kinetic_energy"] + readings[3]["potential_energy"], height) / SHARE)
        if excess > 0:
            low, at_low = middle, excess
        else:
            high, at_high = middle, excess
    yield [answer(float(np.exp(middle)))]


def measure(engine, knobs):
    """The same search by halving in the engine, much finer."""
    start = engine.save()
    low, high = LOW, HIGH
    for _ in range(30):
        height = sqrt(low * high)
        engine.restore(start)
        engine.add_ball("probe", np.array([0.0, 0.0, RADIUS + height]), DENSITY, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(_wait(height)))
        speed, place = engine.twist("probe").linear[2], engine.pose("probe").position[2]
        if _share(speed**2 / 2 + GRAVITY * place, height) > SHARE:
            low = height
        else:
            high = height
    return sqrt(low * high)
