"""Scene 66: one bounce gives the panel's normal and its restitution."""

from math import atan2, cos, degrees, sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
DENSITY = 1000.0
START_Z = 2.3
FACE_Z = 1.0
FLIGHT_S = 0.7


def _tilt_and_restitution(speed, height, time):
    """Tilt [rad] and e from the ball's velocity and height at some time after one bounce off the panel."""
    along_normal = np.array(speed) + np.array([0.0, 0.0, GRAVITY * time])
    tilt = atan2(along_normal[0], along_normal[2])
    drop = START_Z - FACE_Z - RADIUS / cos(tilt)
    lost = GRAVITY * (START_Z - height) - float(np.dot(speed, speed)) / 2
    return tilt, sqrt(1 - lost / (GRAVITY * drop * cos(tilt) ** 2))


def solve(task):
    """Drop a ball onto the panel and read it once after the bounce."""
    readings = yield [
        call("create_objects", name="probe", pos=[0, 0, START_Z], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS),
        call("step", duration=FLIGHT_S),
        call("get_velocity", object_id="probe"),
        call("get_position", object_id="probe"),
    ]
    clock = readings[1]["sim_time"]
    tilt, restitution = _tilt_and_restitution(readings[2]["velocity"], readings[3]["position"][2], clock)
    yield [answer([degrees(tilt), restitution])]


def measure(engine, knobs):
    """The drawn tilt, and the ratio of the normal speeds of a drop in the engine."""
    place, colour = np.array([0.0, 0.0, START_Z]), np.ones(4)
    engine.add_ball("probe", place, DENSITY, RADIUS, colour, {})
    engine.step(engine.whole_steps(FLIGHT_S))
    tilt = np.radians(knobs["tilt"])
    normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    speed, height = engine.twist("probe").linear, engine.pose("probe").position[2]
    impact = sqrt(2 * GRAVITY * (START_Z - FACE_Z - RADIUS / cos(tilt))) * cos(tilt)
    # Energy, not timing: the soft contact lasts some 30 ms, in which gravity goes on acting.
    lost = GRAVITY * (START_Z - height) - float(speed @ speed) / 2
    assert float(normal @ speed) > -impact
    return [knobs["tilt"], sqrt(1 - 2 * lost / impact**2)]
