"""Scene 66: one bounce gives the panel's normal and its restitution."""

from math import atan2, cos, degrees, radians, sin, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
DENSITY = 1000.0
START_Z = 2.3
FACE_Z = 1.0
FLIGHT_S = 0.7


def _impact(tilt):
    """Speed along the normal with which the ball meets the panel [m/s]; tilt in rad."""
    return sqrt(2 * GRAVITY * (START_Z - FACE_Z - RADIUS / cos(tilt))) * cos(tilt)


def solve(task):
    """Drop a ball onto the panel, and read momentum and energies for 1 kg once, after the bounce."""
    readings = yield [
        call("create_objects", name="probe", pos=[0, 0, START_Z], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=FLIGHT_S),
        call("get_momentum", object_id="probe", mass=1.0),
        call("get_kinetic_energy", object_id="probe", mass=1.0),
        call("get_potential_energy", object_id="probe", mass=1.0, gravity=GRAVITY),
    ]
    momentum = readings[2]["momentum"]
    tilt = atan2(momentum["x"], momentum["z"] + GRAVITY * readings[1]["sim_time"])
    # Energy, not timing: the soft contact lasts some 30 ms, in which gravity goes on acting.
    lost = GRAVITY * START_Z - readings[3]["kinetic_energy"] - readings[4]["potential_energy"]
    yield [answer([degrees(tilt), sqrt(1 - 2 * lost / _impact(tilt) ** 2)])]


def measure(engine, knobs):
    """The drawn tilt, and the ratio of normal speeds in the engine, w² = v² + 2 g d cos(tilt) at a distance d again."""
    engine.add_ball("probe", np.array([0.0, 0.0, START_Z]), DENSITY, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(FLIGHT_S))
    tilt = radians(knobs["tilt"])
    normal = np.array([sin(tilt), 0.0, cos(tilt)])
    speed = float(normal @ engine.twist("probe").linear)
    distance = float(normal @ (engine.pose("probe").position - np.array([0.0, 0.0, FACE_Z]))) - RADIUS
    return [knobs["tilt"], sqrt(speed**2 + 2 * GRAVITY * cos(tilt) * distance) / _impact(tilt)]
