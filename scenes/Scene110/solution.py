"""Scene 110: take the rope away, and let the buffer weigh the falling weight."""

from math import sqrt

from scenes.protocol import answer, call

GRAVITY = 9.81
STIFFNESS = 400.0
ROPE_S = 0.6
STEP_S = 0.005
START_Z = 10.0
INTO_S = 0.04
"""How long the weight is in the buffer when it is looked at."""


def _deepest(mass, depth, speed):
    """Where all energy is in the spring: k x² / 2 - m g x stays what it is, plus the motion."""
    weight = mass * GRAVITY
    energy = mass * speed**2 / 2 + STIFFNESS * depth**2 / 2 - weight * depth
    return (weight + sqrt(weight**2 + 2 * STIFFNESS * energy)) / STIFFNESS


def solve(task):
    """Fall back to the start, go on a little, and look at the acceleration in the buffer."""
    readings = yield [
        call("step", duration=ROPE_S),
        call("delete_objects", object_id="object_3"),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]
    height, rise = readings[2]["position"][2] - START_Z, readings[3]["velocity"][2]
    back = (rise + sqrt(rise**2 + 2 * GRAVITY * height)) / GRAVITY
    readings = yield [
        call("step", duration=back + INTO_S),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
        call("get_acceleration", object_id="object_1"),
    ]
    depth, speed = START_Z - readings[1]["position"][2], -readings[2]["velocity"][2]
    # The acceleration is the mean over the last step, so it belongs to the place half a step ago.
    mass = STIFFNESS * (depth - speed * STEP_S / 2) / (readings[3]["z"] + GRAVITY)
    yield [answer(_deepest(mass, depth, speed))]


def theory(knobs):
    """Atwood's acceleration for 0.6 s, then energy down to the deepest point."""
    pull = GRAVITY * (knobs["ratio"] - 1) / (knobs["ratio"] + 1)
    height, speed = pull * ROPE_S**2 / 2, pull * ROPE_S
    return _deepest(knobs["m1"], 0.0, sqrt(speed**2 + 2 * GRAVITY * height))


def measure(engine, knobs):
    """The lowest place in the engine."""
    engine.step(engine.whole_steps(ROPE_S))
    engine.remove("object_3")
    lowest = START_Z
    for _ in range(engine.whole_steps(3.0)):
        engine.step(1)
        lowest = min(lowest, engine.pose("object_1").position[2])
    return float(START_Z - lowest)
