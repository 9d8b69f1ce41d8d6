"""Scene 41: drop a ball and compare the energies before and after its second bounce."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
RADIUS = 0.1
DENSITY = 1000.0
DROP = 1.2
LOOK_S = 0.06


def _two_heights():
    """Two looks at the ball, a known time apart: enough for its energy in free flight."""
    return [
        call("get_position", object_id="probe"),
        call("step", duration=LOOK_S),
        call("get_position", object_id="probe"),
    ]


def _flight(readings):
    """Upward speed at the last look, and the peak's height above first contact."""
    low, high = readings[-3]["position"][2], readings[-1]["position"][2]
    speed = (high - low) / LOOK_S - GRAVITY * LOOK_S / 2
    return speed, high - RADIUS + speed * abs(speed) / (2 * GRAVITY), high - RADIUS


def solve(task):
    """Drop; after the first bounce work out when the second comes; after that compare the two flights."""
    fall = sqrt(2 * DROP / GRAVITY)
    yield [
        call("create_objects", name="probe", pos=[0, 0, RADIUS + DROP], density=DENSITY, rgba=[1, 0, 0, 1]),
        call("step", duration=fall + 0.08),
    ]
    first = yield _two_heights()
    speed, peak, height = _flight(first)
    until_contact = (speed + sqrt(max(speed**2 + 2 * GRAVITY * height, 0.0))) / GRAVITY
    second = yield [call("step", duration=until_contact + 0.08), *_two_heights()]
    peak_after = _flight(second)[1]
    yield [answer(sqrt(peak_after / peak))]


def measure(engine, knobs):
    """Energy after over energy before a drop from the same height, followed in the engine's own speeds."""
    place, colour = np.array([0.0, 0.0, RADIUS + DROP]), np.ones(4)
    engine.add_ball("probe", place, DENSITY, RADIUS, colour, {})
    engine.step(engine.whole_steps(sqrt(2 * DROP / GRAVITY) + 0.08))
    speed = engine.twist("probe").linear[2]
    height = engine.pose("probe").position[2] - RADIUS
    return float(sqrt((speed**2 / 2 + GRAVITY * height) / (GRAVITY * DROP)))
