"""Scene 35: close in on the launch speed that just clears a wall nobody can measure."""

from math import log, sqrt

import numpy as np

from scenes.protocol import answer, call

START = (0.0, 0.0, 1.0)
RADIUS = 0.1
HALF_THICKNESS = 0.05
LOW, HIGH = 2.0, 25.0
"""Far outside of all that the wall may ask for."""
BEHIND = 5.3
"""Here the ball is past any wall [m]."""
PROBES = 10
TOUCHED = 1e-3
"""Loss of momentum per kg [m/s] beyond that to the air: a contact takes more."""


def _launch(speed, duration, towards=1.0):
    """One flight from the post at 45°, and the horizontal momentum and the place at its end."""
    part = speed / sqrt(2)
    return [
        call("move_object", object_id="object_1", x=START[0], y=START[1], z=START[2]),
        call("set_velocity", object_id="object_1", velocity_vector=[towards * part, 0, part]),
        call("step", duration=duration),
        call("get_momentum", object_id="object_1", mass=1.0),
        call("get_position", object_id="object_1"),
    ]


def solve(task):
    """Launch away from the wall to get the drag rate c from p = p0 - c x; then halve the range of speeds."""
    readings = yield _launch(10.0, 1.0, towards=-1.0)
    drag = (10.0 / sqrt(2) + readings[3]["momentum"]["x"]) / -readings[4]["position"][0]
    low, high = LOW, HIGH
    for _ in range(PROBES):
        speed = sqrt(low * high)
        forward = speed / sqrt(2)
        if drag * BEHIND >= forward:
            low = speed
            continue
        readings = yield _launch(speed, -log(1 - drag * BEHIND / forward) / drag)
        lost = forward - readings[3]["momentum"]["x"] - drag * readings[4]["position"][0]
        low, high = (speed, high) if abs(lost) > TOUCHED else (low, speed)
    yield [answer(sqrt(low * high))]


def _clearance(speed, knobs):
    """Least distance of the ball's centre from the wall's top, negative below it."""
    forward, drag = speed / sqrt(2), knobs["drag"]
    near, far = knobs["x"] - HALF_THICKNESS, knobs["x"] + HALF_THICKNESS
    x = np.linspace(near - RADIUS, far + RADIUS, 601)
    if drag * x[-1] >= forward:
        return -1.0
    time = -np.log(1 - drag * x / forward) / drag
    z = START[2] + (forward + knobs["g"] / drag) * x / forward - knobs["g"] * time / drag
    above = z - (START[2] + knobs["rise"] * knobs["x"])
    if np.any(above < 0):
        return -1.0
    beside = np.maximum(np.abs(x - knobs["x"]) - HALF_THICKNESS, 0.0)
    return float(np.min(np.hypot(beside, above)))


def theory(knobs):
    """The speed at which the path with linear drag keeps one radius from the wall's top."""
    low, high = LOW, HIGH
    for _ in range(40):
        speed = (low + high) / 2
        low, high = (speed, high) if _clearance(speed, knobs) < RADIUS else (low, speed)
    return (low + high) / 2


def measure(engine, knobs):
    """The engine's own least speed of a launch that ends with the momentum of a free flight."""
    start = engine.save()
    low, high = LOW, HIGH
    for _ in range(20):
        speed = sqrt(low * high)
        forward = speed / sqrt(2)
        engine.restore(start)
        engine.place("object_1", np.array(START), {})
        engine.set_velocity("object_1", np.array([forward, 0.0, forward]))
        for _ in range(engine.whole_steps(6.0) // 20):
            engine.step(20)
            if engine.pose("object_1").position[0] > BEHIND or engine.twist("object_1").linear[0] < 0.1:
                break
        lost = forward - engine.twist("object_1").linear[0] - knobs["drag"] * engine.pose("object_1").position[0]
        cleared = abs(lost) < TOUCHED and engine.pose("object_1").position[0] > BEHIND
        low, high = (low, speed) if cleared else (speed, high)
    return sqrt(low * high)
