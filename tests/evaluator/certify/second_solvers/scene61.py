"""Attach a very light ball to each drum as a pointer, apply equal torques and compare the speeds of the pointers."""

from scenes.protocol import Protocol, answer, call

DRUMS = {"object_1": -0.5, "object_2": 0.5}
"""Drum and the x of its axis [m]."""
ARM = 0.25
"""Distance of the pointer from the axis [m]; the pointer does not touch the drum."""
RADIUS = 0.02
DENSITY = 1.0
"""Density of the pointers [kg/m³]; their mass of 3e-5 kg is negligible."""
TORQUE = 0.05
"""Torque on each drum [N·m]."""
TWIST_TIME = 1.0
ALIKE = 1.1
"""Speeds with a smaller ratio count as equal; unequal drums differ by 20 % or more."""


def solve(task: str) -> Protocol:
    """Equal torque for an equal time gives equal angular momentum: the slower drum has the larger moment of inertia."""
    for drum, x in DRUMS.items():
        pointer = f"pointer_{drum}"
        yield [
            call(
                "create_objects",
                name=pointer,
                pos=[x, ARM, 0.5],
                density=DENSITY,
                rgba=[1, 0, 0, 1],
                radius=RADIUS,
            ),
            call("attach_objects", object1_id=drum, object2_id=pointer),
            call("apply_torque", object_id=drum, torque_vector=[0, 0, TORQUE]),
        ]
    readings = yield [
        call("step", duration=TWIST_TIME),
        *[call("get_velocity", object_id=f"pointer_{drum}") for drum in DRUMS],
    ]
    first, second = (sum(part**2 for part in reading["velocity"]) ** 0.5 for reading in readings[1:])
    slower = "object_1" if first < second else "object_2"
    yield [answer(slower if max(first, second) / min(first, second) > ALIKE else "0")]
