"""Tools that read the state of the laboratory. None of them lets time pass or changes anything."""

import numpy as np

from physment_mcp.errors import NotPossible
from physment_mcp.mechanics import centre_of_mass
from physment_mcp.session import Session
from physment_mcp.tools.base import NoArguments, ObjectArguments, Tool, plain
from physment_mcp.tools.results import (
    Acceleration,
    CenterOfMass,
    Components,
    Displacement,
    Parameters,
    Position,
    Torque,
    Velocity,
)


def _get_position(session: Session, args: ObjectArguments) -> Position:
    item = session.readable(args.object_id, "position")
    pose = session.world.pose(item.body)
    orientation = plain(pose.quaternion) if session.may_read(item, "orientation") else None
    turn = session.world.turn(item.body) if session.may_read(item, "angle") else None
    return Position(
        sim_time=session.world.time,
        position=plain(pose.position),
        orientation=orientation,
        angle=None if turn is None else turn.angle,
    )


def _get_velocity(session: Session, args: ObjectArguments) -> Velocity:
    item = session.readable(args.object_id, "velocity")
    turn = session.world.turn(item.body) if session.may_read(item, "spin") else None
    return Velocity(
        sim_time=session.world.time,
        velocity=plain(session.world.velocity(item.body)),
        angular_velocity=None if turn is None else turn.spin,
    )


def _get_acceleration(session: Session, args: ObjectArguments) -> Acceleration:
    item = session.readable(args.object_id, "velocity")
    x, y, z = plain(session.world.acceleration(item.body))
    return Acceleration(sim_time=session.world.time, x=x, y=y, z=z)


def _get_torque(session: Session, args: ObjectArguments) -> Torque:
    item = session.find(args.object_id)
    x, y, z = plain(session.world.applied_torque(item.body))
    return Torque(sim_time=session.world.time, torque=Components(x=x, y=y, z=z))


def _get_parameters(session: Session, args: ObjectArguments) -> Parameters:
    item = session.find(args.object_id)
    shape = session.world.shape(item.body)
    allowed = {
        "mass": session.may_read(item, "mass"),
        "bounding_box": session.may_read(item, "size"),
        "type": session.may_read(item, "type"),
    }
    return Parameters(
        sim_time=session.world.time,
        mass=session.world.mass(item.body) if allowed["mass"] else None,
        bounding_box=plain(shape.box) if allowed["bounding_box"] and shape.box is not None else None,
        type=shape.type if allowed["type"] else None,
        withheld=[field for field, may in allowed.items() if not may],
    )


def _get_displacement(session: Session, args: ObjectArguments) -> Displacement:
    item = session.readable(args.object_id, "position")
    path = session.world.pose(item.body).position - item.start
    return Displacement(sim_time=session.world.time, displacement=float(np.linalg.norm(path)))


def _get_center_of_mass(session: Session, args: NoArguments) -> CenterOfMass:
    del args
    movable = [item for item in session.known() if session.world.is_movable(item.body)]
    counted = [item for item in movable if session.may_read(item, "mass") and session.may_read(item, "position")]
    if not counted:
        raise NotPossible("there is no movable object whose mass and position you may both read")
    centre = centre_of_mass(
        np.array([session.world.mass(item.body) for item in counted]),
        np.array([session.world.centre(item.body) for item in counted]),
    )
    x, y, z = plain(centre)
    return CenterOfMass(
        sim_time=session.world.time,
        center_of_mass=Components(x=x, y=y, z=z),
        included=[item.object_id for item in counted],
        excluded=[item.object_id for item in movable if item not in counted],
    )


GET_POSITION = Tool(
    "get_position",
    "Position",
    "Read where an object is: the origin of its frame in world coordinates, and its orientation"
    " and its joint angle if the scene shows them.",
    ObjectArguments,
    Position,
    _get_position,
    reads_only=True,
)
GET_VELOCITY = Tool(
    "get_velocity",
    "Velocity",
    "Read the velocity of an object's centre of mass, world frame, and its joint speed if the scene shows it.",
    ObjectArguments,
    Velocity,
    _get_velocity,
    reads_only=True,
)
GET_ACCELERATION = Tool(
    "get_acceleration",
    "Acceleration",
    "Read an object's acceleration: the change of its centre of mass's velocity over the last time step, divided by"
    " the time step. An error before the first step, and after the object was moved, created or given a velocity,"
    " until the next step.",
    ObjectArguments,
    Acceleration,
    _get_acceleration,
    reads_only=True,
)
GET_TORQUE = Tool(
    "get_torque",
    "Applied torque",
    "Read the external torque that is set on an object now.",
    ObjectArguments,
    Torque,
    _get_torque,
    reads_only=True,
)
GET_PARAMETERS = Tool(
    "get_parameters",
    "Parameters",
    "Read an object's mass, bounding box and shape, as far as this scene shows them.",
    ObjectArguments,
    Parameters,
    _get_parameters,
    reads_only=True,
)
GET_DISPLACEMENT = Tool(
    "get_displacement",
    "Displacement",
    "Read how far an object is from where it was at the start of the episode, or from where it was created.",
    ObjectArguments,
    Displacement,
    _get_displacement,
    reads_only=True,
)
GET_CENTER_OF_MASS = Tool(
    "get_center_of_mass",
    "Centre of mass",
    "Read the common centre of mass of the movable objects whose mass and position this scene shows; the others are"
    " listed as excluded.",
    NoArguments,
    CenterOfMass,
    _get_center_of_mass,
    reads_only=True,
)
