"""Mass of the flywheel by the work-energy theorem: work of a known torque over rotational energy per kilogram."""

from scenes.protocol import Protocol, answer, call

FLYWHEEL = "object_2"
TORQUE = 0.5
"""About the vertical axis [N·m]."""
SLICE = 0.05
"""Time between two readings [s]."""
SLICES = 40


def solve(task: str) -> Protocol:
    """For an assumed 1 kg, energy e and angular momentum l give the angular speed 2 e / l; the mass is work / e."""
    yield [
        call("find_objects"),
        call("apply_torque", object_id=FLYWHEEL, torque_vector=[0, 0, TORQUE]),
    ]
    readings = (
        yield [
            call("step", duration=SLICE),
            call("get_rotational_energy", object_id=FLYWHEEL, mass=1),
            call("get_angular_momentum", object_id=FLYWHEEL, mass=1),
        ]
        * SLICES
    )
    energies = [reading["rotational_energy"] for reading in readings[1::3]]
    momenta = [reading["angular_momentum"]["z"] for reading in readings[2::3]]
    turning = [2 * e / momentum for e, momentum in zip(energies, momenta, strict=True)]
    angle = SLICE * (sum(turning) - (turning[0] + turning[-1]) / 2)
    yield [answer(TORQUE * angle / (energies[-1] - energies[0]))]
