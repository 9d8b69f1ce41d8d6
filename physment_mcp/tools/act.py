"""Tools that act on objects: push, twist, move, set a velocity, collide."""

import math
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Annotated, Literal

from pydantic import Field

from physment_mcp.errors import BeyondLimit, NotPermitted, NotPossible, RefusedCall
from physment_mcp.mechanics import rotation_matrix
from physment_mcp.session import LabObject, Session
from physment_mcp.tools.base import (
    LIMIT_SLACK,
    Arguments,
    Number,
    ObjectArguments,
    ObjectId,
    Tool,
    Vector,
    array,
    plain,
)
from physment_mcp.tools.results import Collision, ForceSet, Moved, Shifted, TorqueSet, VelocitySet
from physment_mcp.world import Contact

_RESTING_SPEED = 1e-3
"""Contacts that close more slowly than this [m/s] are at rest and get no elastic response."""


class PlaceArguments(ObjectArguments):
    """Arguments of `move_object`."""

    x: Annotated[Number, Field(description="World x [m].")]
    y: Annotated[Number, Field(description="World y [m].")]
    z: Annotated[Number, Field(description="World z, up [m].")]


class ShiftArguments(ObjectArguments):
    """Arguments of `change_position`."""

    dx: Annotated[Number, Field(description="Shift along x [m].")]
    dy: Annotated[Number, Field(description="Shift along y [m].")]
    dz: Annotated[Number, Field(description="Shift along z [m].")]
    in_world_frame: Annotated[bool, Field(description="True: world axes. False: the object's own axes.")] = True


class VelocityArguments(ObjectArguments):
    """Arguments of `set_velocity`."""

    velocity_vector: Annotated[Vector, Field(description="Velocity of the centre of mass [x, y, z], world [m/s].")]


class ForceArguments(ObjectArguments):
    """Arguments of `apply_force`."""

    force_vector: Annotated[Vector, Field(description="Force [x, y, z], world [N].")]


class TorqueArguments(ObjectArguments):
    """Arguments of `apply_torque`."""

    torque_vector: Annotated[Vector, Field(description="Torque [x, y, z], world [N·m].")]


class CollisionArguments(Arguments):
    """Arguments of `detect_collision`."""

    obj1_id: ObjectId
    obj2_id: ObjectId
    elastic_response: Annotated[
        bool,
        Field(description="True: bounce the two off each other elastically if they are closing in. False: only look."),
    ] = True


_SHORT_MOVE = "its joints let it move only along its slides, and within their range; it went as near as they allow"
"""Note in the result if the joints of an object prevented a part of the move."""


def _check_loose(session: Session, item: LabObject) -> None:
    """Raise if an object is attached to another one, or the agent may not read its position."""
    moving = set(session.world.with_children(item.body))
    if any(other.attached for other in session.state.objects.values() if other.body in moving):
        raise NotPossible(f"{item.object_id} is attached to another object and cannot be moved by itself")
    session.readable(item.object_id, "position")


@contextmanager
def _unmoved(item: LabObject) -> Generator[None]:
    """Add the object's id to the message of a `NotPossible` error that the block raises."""
    try:
        yield
    except NotPossible as refusal:
        raise NotPossible(f"{item.object_id} was not moved: {refusal}") from refusal


def _move_object(session: Session, args: PlaceArguments) -> Moved:
    item = session.movable(args.object_id)
    _check_loose(session, item)
    with _unmoved(item):
        arrived = session.world.place(item.body, array([args.x, args.y, args.z]), session.obstacles())
    note = None if arrived else _SHORT_MOVE
    return Moved(sim_time=session.world.time, position=plain(session.world.pose(item.body).position), note=note)


def _change_position(session: Session, args: ShiftArguments) -> Shifted:
    item = session.movable(args.object_id)
    shift = array([args.dx, args.dy, args.dz])
    if not args.in_world_frame:
        session.readable(item.object_id, "orientation")
        shift = rotation_matrix(session.world.pose(item.body).quaternion) @ shift
    _check_loose(session, item)
    with _unmoved(item):
        arrived = session.world.shift(item.body, shift, session.obstacles())
    note = None if arrived else _SHORT_MOVE
    return Shifted(sim_time=session.world.time, new_position=plain(session.world.pose(item.body).position), note=note)


def _set_velocity(session: Session, args: VelocityArguments) -> VelocitySet:
    item = session.movable(args.object_id)
    try:
        session.world.set_velocity(item.body, array(args.velocity_vector))
    except NotPossible as refusal:
        raise NotPossible(f"{item.object_id} cannot be given a velocity: {refusal}") from refusal
    # Joints may keep a part of the old velocity.
    obtained = plain(session.world.velocity(item.body)) if session.may_read(item, "velocity") else None
    return VelocitySet(sim_time=session.world.time, status="velocity set", object_id=item.object_id, velocity=obtained)


def _check_load(session: Session, kind: Literal["force", "torque"], load: Sequence[float]) -> None:
    """Raise if a force [N] or torque [N·m] is larger than the scene allows.

    Raises:
        BeyondLimit: Its magnitude exceeds the limit.
    """
    limit, unit = (session.limits.force, "N") if kind == "force" else (session.limits.torque, "N·m")
    size = math.hypot(*load)
    if limit is None or size <= limit * (1 + LIMIT_SLACK):
        return
    if limit == 0:
        raise BeyondLimit(f"no {kind} can be applied in this laboratory")
    raise BeyondLimit(f"a {kind} of {size:.6g} {unit} is too large: at most {limit:g} {unit} can be applied here")


def _apply_force(session: Session, args: ForceArguments) -> ForceSet:
    item = session.movable(args.object_id)
    _check_load(session, "force", args.force_vector)
    session.world.push(item.body, force=array(args.force_vector))
    return ForceSet(
        sim_time=session.world.time, status="force set", object_id=item.object_id, force=plain(array(args.force_vector))
    )


def _apply_torque(session: Session, args: TorqueArguments) -> TorqueSet:
    item = session.movable(args.object_id)
    _check_load(session, "torque", args.torque_vector)
    session.world.push(item.body, torque=array(args.torque_vector))
    return TorqueSet(
        sim_time=session.world.time,
        status="torque set",
        object_id=item.object_id,
        torque=plain(array(args.torque_vector)),
    )


def _detect_collision(session: Session, args: CollisionArguments) -> Collision:
    first, second = session.find(args.obj1_id), session.find(args.obj2_id)
    if first is second:
        raise NotPossible(f"{first.object_id} cannot collide with itself; name two objects")
    if args.elastic_response:
        for item in (first, second):
            if not item.permissions.actuate:
                raise NotPermitted(
                    f"{item.object_id} is sealed in this scene: call detect_collision with elastic_response=false"
                )
    touching = session.world.contact(first.body, second.body)
    impulse = _respond(session, first, second, touching) if args.elastic_response else None
    pair = (first, second)
    seen = touching is not None
    shows_place = seen and all(session.may_read(item, "position") for item in pair)
    # The normal of a flat face reveals its tilt; that of a sphere reveals only where it is touched.
    shows_normal = shows_place and all(
        session.may_read(item, "orientation")
        or (session.may_read(item, "type") and session.world.shape(item.body).type == "sphere")
        for item in pair
    )
    # The closing speed is the velocity along the normal, so together with the velocities it reveals the normal.
    shows_speed = shows_normal and all(session.may_read(item, "velocity") for item in pair)
    # The impulse reveals the effective mass, and with known masses the closing speed.
    shows_impulse = (shows_speed or not seen) and all(
        session.may_read(item, "mass") or not session.world.is_movable(item.body) for item in pair
    )
    return Collision(
        sim_time=session.world.time,
        collision_detected=seen,
        contact_point=plain(touching.point) if touching and shows_place else None,
        normal=plain(touching.normal) if touching and shows_normal else None,
        approach_speed=touching.approach_speed if touching and shows_speed else None,
        impulse=impulse if shows_impulse else None,
    )


def _respond(session: Session, first: LabObject, second: LabObject, touching: Contact | None) -> float:
    if touching is None or touching.approach_speed <= _RESTING_SPEED:
        return 0.0
    try:
        return session.world.bounce(first.body, second.body)
    except NotPossible as refusal:
        raise RefusedCall(f"no elastic response is possible: {refusal}") from refusal


MOVE_OBJECT = Tool(
    "move_object",
    "Move",
    "Put an object's origin at a place. It keeps its velocity; what is jointed to it rides along. On slides it goes as"
    " near as they allow. Refused where it would overlap another object by more than 1 mm, and for what is fixed,"
    " sealed or attached. No time passes.",
    PlaceArguments,
    Moved,
    _move_object,
    idempotent=True,
)
CHANGE_POSITION = Tool(
    "change_position",
    "Shift",
    "Shift an object by a displacement, along the world axes or its own; same rules as move_object. No time passes.",
    ShiftArguments,
    Shifted,
    _change_position,
)
SET_VELOCITY = Tool(
    "set_velocity",
    "Set velocity",
    "Give an object's centre of mass a velocity, world frame; its spin stays. On joints it gets the nearest velocity"
    " they allow, which is returned. No time passes.",
    VelocityArguments,
    VelocitySet,
    _set_velocity,
    idempotent=True,
)
APPLY_FORCE = Tool(
    "apply_force",
    "Set force",
    "Set the external force on an object, at its centre of mass, world frame. It acts during every later step until it"
    " is set again; [0, 0, 0] clears it. No time passes.",
    ForceArguments,
    ForceSet,
    _apply_force,
    idempotent=True,
)
APPLY_TORQUE = Tool(
    "apply_torque",
    "Set torque",
    "Set the external torque on an object, world frame. It acts during every later step until it is set again;"
    " [0, 0, 0] clears it. No time passes.",
    TorqueArguments,
    TorqueSet,
    _apply_torque,
    idempotent=True,
)
DETECT_COLLISION = Tool(
    "detect_collision",
    "Detect collision",
    "Tell whether two objects touch now. If they do, are closing in and elastic_response is true, they are bounced off"
    " each other perfectly elastically along the normal. With elastic_response=false it only looks. No time passes.",
    CollisionArguments,
    Collision,
    _detect_collision,
)
