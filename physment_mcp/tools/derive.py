"""Tools that compute a quantity from readings and from values that the agent supplies. They change nothing."""

from typing import Annotated

import numpy as np
from pydantic import Field

from physment_mcp.errors import BadArgument, NotPermitted, NotPossible
from physment_mcp.mechanics import (
    Array,
    angular_momentum,
    kinetic_energy,
    momentum,
    potential_energy,
    rotation_matrix,
    rotational_energy,
)
from physment_mcp.session import Session
from physment_mcp.tools.base import Arguments, MassArguments, Number, Tool, array, plain
from physment_mcp.tools.results import (
    AngularMomentum,
    Components,
    Force,
    KineticEnergy,
    Momentum,
    PotentialEnergy,
    Rotation,
    RotationalEnergy,
)


class PotentialEnergyArguments(MassArguments):
    """Arguments of `get_potential_energy`."""

    gravity: Annotated[Number, Field(description="Gravitational acceleration to compute with [m/s²].")] = 9.81


class QuaternionArguments(Arguments):
    """Arguments of `quat_to_rot_matrix`."""

    q: Annotated[list[Number], Field(min_length=4, max_length=4, description="Quaternion [w, x, y, z].")]


def _compute_force(session: Session, args: MassArguments) -> Force:
    item = session.readable(args.object_id, "velocity")
    x, y, z = plain(args.mass * session.world.acceleration(item.body))
    return Force(sim_time=session.world.time, x=x, y=y, z=z)


def _get_kinetic_energy(session: Session, args: MassArguments) -> KineticEnergy:
    item = session.readable(args.object_id, "velocity")
    energy = kinetic_energy(args.mass, session.world.velocity(item.body))
    return KineticEnergy(sim_time=session.world.time, kinetic_energy=energy)


def _get_potential_energy(session: Session, args: PotentialEnergyArguments) -> PotentialEnergy:
    item = session.readable(args.object_id, "position")
    energy = potential_energy(args.mass, args.gravity, float(session.world.centre(item.body)[2]))
    return PotentialEnergy(sim_time=session.world.time, potential_energy=energy)


def _spin(session: Session, args: MassArguments) -> tuple[Array, Array]:
    """Return the inertia tensor and the spin of an object.

    The tensor is scaled to the mass that the agent supplies, so it does not reveal the true mass.
    """
    item = session.readable(args.object_id, "velocity")
    if item.permissions.spin is False:
        raise NotPermitted(f"the spin of {item.object_id} is withheld in this scene; find it by experiment")
    true_mass = session.world.mass(item.body)
    if true_mass <= 0:
        raise NotPossible(f"{item.object_id} has no mass of its own, so it has no inertia")
    return args.mass * session.world.inertia(item.body) / true_mass, session.world.twist(item.body).angular


def _get_rotational_energy(session: Session, args: MassArguments) -> RotationalEnergy:
    energy = rotational_energy(*_spin(session, args))
    return RotationalEnergy(sim_time=session.world.time, rotational_energy=energy)


def _get_angular_momentum(session: Session, args: MassArguments) -> AngularMomentum:
    x, y, z = plain(angular_momentum(*_spin(session, args)))
    return AngularMomentum(sim_time=session.world.time, angular_momentum=Components(x=x, y=y, z=z))


def _get_momentum(session: Session, args: MassArguments) -> Momentum:
    item = session.readable(args.object_id, "velocity")
    x, y, z = plain(momentum(args.mass, session.world.velocity(item.body)))
    return Momentum(sim_time=session.world.time, momentum=Components(x=x, y=y, z=z))


def _quat_to_rot_matrix(session: Session, args: QuaternionArguments) -> Rotation:
    if not np.any(args.q):
        raise BadArgument("quat_to_rot_matrix: q must not be the zero quaternion; no rotation is [1, 0, 0, 0]")
    matrix = rotation_matrix(array(args.q))
    return Rotation(sim_time=session.world.time, rotation_matrix=[plain(row) for row in matrix])


COMPUTE_FORCE = Tool(
    "compute_force",
    "Net force",
    "Compute the net force on an object: the mass you give times its acceleration over the last time step.",
    MassArguments,
    Force,
    _compute_force,
    reads_only=True,
)
GET_KINETIC_ENERGY = Tool(
    "get_kinetic_energy",
    "Kinetic energy",
    "Compute an object's translational kinetic energy, ½ m v², with the mass you give.",
    MassArguments,
    KineticEnergy,
    _get_kinetic_energy,
    reads_only=True,
)
GET_POTENTIAL_ENERGY = Tool(
    "get_potential_energy",
    "Potential energy",
    "Compute m g z of an object's centre of mass, with the mass and the gravity you give; zero at z = 0.",
    PotentialEnergyArguments,
    PotentialEnergy,
    _get_potential_energy,
    reads_only=True,
)
GET_ROTATIONAL_ENERGY = Tool(
    "get_rotational_energy",
    "Rotational energy",
    "Compute the kinetic energy of an object's spin about its centre of mass, as if it had the mass you give and its"
    " own shape and mass distribution.",
    MassArguments,
    RotationalEnergy,
    _get_rotational_energy,
    reads_only=True,
)
GET_MOMENTUM = Tool(
    "get_momentum",
    "Momentum",
    "Compute an object's linear momentum, m v, with the mass you give.",
    MassArguments,
    Momentum,
    _get_momentum,
    reads_only=True,
)
GET_ANGULAR_MOMENTUM = Tool(
    "get_angular_momentum",
    "Angular momentum",
    "Compute an object's angular momentum about its centre of mass, as if it had the mass you give and its own shape"
    " and mass distribution.",
    MassArguments,
    AngularMomentum,
    _get_angular_momentum,
    reads_only=True,
)
QUAT_TO_ROT_MATRIX = Tool(
    "quat_to_rot_matrix",
    "Rotation matrix",
    "Convert a quaternion [w, x, y, z] into a 3 x 3 rotation matrix; it is normalised first.",
    QuaternionArguments,
    Rotation,
    _quat_to_rot_matrix,
    reads_only=True,
)
