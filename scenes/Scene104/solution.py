"""Scene 104: join puck and bob as their centres meet, and add the height their speed is still worth."""

from math import sqrt

from scenes.protocol import answer, call

GRAVITY = 9.81
SPEED = 5.0
DISTANCE = 3.0
ARM = 2.0
BOB_INERTIA = 0.4 * 0.08**2
"""Of the bob about its centre, per kg."""


def solve(task):
    """Follow the pair upward, and add v² / 2g when it is slow."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=DISTANCE / SPEED),
        call("get_position", object_id="object_1"),
        call("attach_objects", object1_id="object_1", object2_id="object_2", joint="ball"),
        call("step", duration=0.1),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]
    base = readings[2]["position"][2]
    for _ in range(4):
        rate = sum(part**2 for part in readings[-1]["velocity"])
        height = readings[-2]["position"][2] - base + rate / (2 * GRAVITY)
        left = sqrt(ARM / GRAVITY) * sqrt(rate / (2 * GRAVITY * height)) if height > 0 else 0.1
        readings = yield [
            call("step", duration=max(left / 2, 0.005)),
            call("get_position", object_id="object_1"),
            call("get_velocity", object_id="object_1"),
        ]
    rate = sum(part**2 for part in readings[-1]["velocity"])
    yield [answer(readings[-2]["position"][2] - base + rate / (2 * GRAVITY))]


def theory(knobs):
    """Angular momentum about the pivot is kept in the catch, energy after it; the bob's own inertia is counted."""
    puck, bob = knobs["puck"], knobs["bob"]
    inertia = (puck + bob) * ARM**2 + bob * BOB_INERTIA
    spin = puck * SPEED * ARM
    return spin**2 / (2 * inertia) / ((puck + bob) * GRAVITY)


def measure(engine, knobs):
    """The highest point of the bob in the engine."""
    engine.set_velocity("object_1", [SPEED, 0.0, 0.0])
    engine.step(engine.whole_steps(DISTANCE / SPEED))
    base = engine.pose("object_2").position[2]
    engine.join("object_1", "object_2", "ball")
    highest = base
    for _ in range(engine.whole_steps(1.5)):
        engine.step(1)
        highest = max(highest, engine.pose("object_2").position[2])
    return float(highest - base)
