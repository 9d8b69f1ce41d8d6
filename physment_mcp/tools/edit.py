"""Tools that change which objects exist: create, delete, reveal, attach."""

import math
import re
from typing import Annotated, Literal

from pydantic import Field

from physment_mcp.errors import BadArgument, BeyondLimit, NotPermitted, NotPossible, quoted
from physment_mcp.session import MAX_CREATED, LabObject, Session
from physment_mcp.tools.base import (
    LIMIT_SLACK,
    Arguments,
    NoArguments,
    ObjectArguments,
    ObjectId,
    Tool,
    Vector,
    array,
    plain,
)
from physment_mcp.tools.results import Attached, Created, Deleted, Found

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
_RESERVED = re.compile(r"object(_.*|\d*)|world|laboratory", re.IGNORECASE)
Share = Annotated[float, Field(ge=0, le=1)]


class CreateArguments(Arguments):
    """Arguments of `create_objects`."""

    name: Annotated[
        str, Field(description="Name of the sphere; becomes its id. A letter, then letters, digits, _ or -.")
    ]
    pos: Annotated[Vector, Field(description="Centre [x, y, z], world [m].")]
    density: Annotated[float, Field(gt=0, le=1e5, description="Density [kg/m³]; mass = density · 4/3 π radius³.")]
    rgba: Annotated[
        list[Share], Field(min_length=4, max_length=4, description="Colour [red, green, blue, opacity], 0 to 1.")
    ]
    radius: Annotated[float, Field(ge=1e-3, le=10, description="Radius [m].")] = 0.1


class AttachArguments(Arguments):
    """Arguments of `attach_objects`."""

    object1_id: ObjectId
    object2_id: ObjectId
    joint: Annotated[
        Literal["weld", "ball", "hinge"],
        Field(description="weld: rigid. ball, hinge: pivot at the second object's origin."),
    ] = "weld"
    axis: Annotated[Vector | None, Field(description="Axis of a hinge [x, y, z], world; null otherwise.")] = None


def _check_created_mass(session: Session, mass: float) -> None:
    """Raise if a new object would bring the total mass of created objects above the limit of the scene.

    Args:
        session: The episode. Deleted objects count as well.
        mass: Mass of the new object [kg].

    Raises:
        BeyondLimit: The total would exceed the limit.
    """
    limit, created = session.limits.created_mass, session.state.created_mass
    if limit is None or created + mass <= limit * (1 + LIMIT_SLACK):
        return
    raise BeyondLimit(
        f"an object of {mass:.6g} kg is too heavy: of the {limit:g} kg that can be created here,"
        f" {max(0.0, limit - created):.6g} kg are left, and what is deleted does not come back"
    )


def _create_objects(session: Session, args: CreateArguments) -> Created:
    if not _NAME.fullmatch(args.name):
        raise BadArgument(
            f"create_objects: {quoted(args.name, 40)} cannot be a name;"
            " use a letter, then up to 39 letters, digits, _ or -"
        )
    if _RESERVED.fullmatch(args.name):
        raise BadArgument(f"create_objects: the name {args.name!r} is reserved; choose another, such as probe")
    if args.name in session.state.objects:
        raise BadArgument(f"create_objects: there is an object {args.name!r} already; choose another name")
    if session.state.created_count >= MAX_CREATED:
        raise NotPossible(f"no more than {MAX_CREATED} objects can be created in an episode")
    mass = args.density * 4 / 3 * math.pi * args.radius**3
    _check_created_mass(session, mass)
    body = f"created:{args.name}"
    position = array(args.pos)
    try:
        session.world.add_ball(body, position, args.density, args.radius, array(args.rgba), session.obstacles())
    except NotPossible as refusal:
        raise NotPossible(f"{args.name} was not created: {refusal}") from refusal
    session.add(args.name, body)
    return Created(
        sim_time=session.world.time,
        status="created",
        name=args.name,
        object_id=args.name,
        position=plain(session.world.pose(body).position),
        density=args.density,
        rgba=args.rgba,
    )


def _delete_objects(session: Session, args: ObjectArguments) -> Deleted:
    item = session.unsealed(args.object_id)
    bodies = set(session.world.with_children(item.body))
    going = [other for other in session.state.objects.values() if other.body in bodies]
    if any(not other.known or not other.permissions.actuate for other in going):
        raise NotPermitted(f"{item.object_id} cannot be deleted in this scene")
    session.world.remove(item.body)
    session.drop({other.object_id for other in going})
    return Deleted(
        sim_time=session.world.time,
        status="deleted",
        object_id=item.object_id,
        also_deleted=[other.object_id for other in going if other is not item],
    )


def _find_objects(session: Session, args: NoArguments) -> Found:
    del args
    revealed = [{"object_id": item.object_id, "name": item.name, **session.describe(item)} for item in session.reveal()]
    status = f"{len(revealed)} hidden object(s) revealed" if revealed else "there is nothing hidden here"
    return Found(sim_time=session.world.time, status=status, revealed=revealed)


def _attach_objects(session: Session, args: AttachArguments) -> Attached:
    first, second = session.unsealed(args.object1_id), session.unsealed(args.object2_id)
    _check_pair(session, first, second)
    axis = None if args.axis is None else array(args.axis)
    if args.joint == "hinge" and (axis is None or not axis.any()):
        raise BadArgument("attach_objects: a hinge needs an axis that is not zero, such as [0, 1, 0]")
    if args.joint != "hinge" and axis is not None:
        raise BadArgument(f"attach_objects: axis belongs to a hinge; leave it out for a {args.joint}")
    session.world.join(first.body, second.body, args.joint, axis)
    session.join(first, second)
    return Attached(sim_time=session.world.time, status="attached", joint=args.joint)


def _check_pair(session: Session, first: LabObject, second: LabObject) -> None:
    if first is second:
        raise NotPossible(f"{first.object_id} cannot be attached to itself; name two objects")
    if frozenset({first.object_id, second.object_id}) in session.state.joined:
        raise NotPossible(f"{first.object_id} and {second.object_id} are attached already")
    if not any(session.world.is_movable(item.body) for item in (first, second)):
        raise NotPossible(f"{first.object_id} and {second.object_id} are both fixed in the laboratory")


CREATE_OBJECTS = Tool(
    "create_objects",
    "Create a sphere",
    "Put a new, free sphere of known density into the laboratory; its name becomes its id. Everything else keeps its"
    " state. Refused where it would overlap something by more than 1 mm, and after"
    f" {MAX_CREATED} objects. No time passes.",
    CreateArguments,
    Created,
    _create_objects,
)
DELETE_OBJECTS = Tool(
    "delete_objects",
    "Delete",
    "Remove an object, what is jointed to it, and every constraint that holds on to it. Everything else keeps its"
    " state. No time passes.",
    ObjectArguments,
    Deleted,
    _delete_objects,
    destructive=True,
)
FIND_OBJECTS = Tool(
    "find_objects",
    "Find hidden objects",
    "Reveal hidden objects, if there are any; from then on they can be used like all others. No time passes.",
    NoArguments,
    Found,
    _find_objects,
    idempotent=True,
)
ATTACH_OBJECTS = Tool(
    "attach_objects",
    "Attach",
    "Join two objects at their present relative pose: rigidly (weld), or with a pivot at the second object's origin"
    " (ball, or hinge about an axis). They no longer collide with each other. No time passes.",
    AttachArguments,
    Attached,
    _attach_objects,
)
