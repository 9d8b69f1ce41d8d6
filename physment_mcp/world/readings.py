"""Readings of a settled model and data: poses, twists, inertia, shapes, contacts. Changes nothing."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GEOM_TYPES = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_HFIELD: "heightfield",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


class Pose(NamedTuple):
    """Body frame in the world: origin (3,) [m] and orientation (4,) [w, x, y, z]."""

    position: Array
    quaternion: Array


class Twist(NamedTuple):
    """Motion of a body, world axes: spin (3,) [rad/s] and velocity of its centre of mass (3,) [m/s]."""

    angular: Array
    linear: Array


class HingeMotion(NamedTuple):
    """Joint angle [rad], which counts whole turns, and joint speed [rad/s] of a hinge, about its axis."""

    angle: float
    spin: float


class Shape(NamedTuple):
    """Shape of a body.

    `type` names its geom, `box` holds the full edge lengths (3,) [m] in the body frame (None if unbounded), `radius`
    [m] is that of a sphere, cylinder or capsule.
    """

    type: str
    box: Array | None
    radius: float | None = None


class Contact(NamedTuple):
    """A contact of two bodies.

    `point` (3,) [m] is the mean over their contacts, `normal` (3,) points from the first body to the second,
    `approach_speed` [m/s] is positive while they approach each other.
    """

    point: Array
    normal: Array
    approach_speed: float


def pose(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Pose:
    """Pose of the body frame. Source: MuJoCo `xpos`, `xquat`."""
    del model
    return Pose(data.xpos[body].copy(), data.xquat[body].copy())


def twist(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Twist:
    """Motion of the body at its centre of mass.

    Source: MuJoCo `mj_objectVelocity` for `mjOBJ_BODY`, world axes; its output is rotation first.
    """
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
    return Twist(velocity[:3], velocity[3:])


def turn(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> HingeMotion | None:
    """Motion of the only hinge among the joints between a body and its parent; None if there is not exactly one.

    Source: MuJoCo `qpos`, `qvel`.
    """
    hinge = only_hinge(model, body)
    return hinge and HingeMotion(float(data.qpos[hinge[0]]), float(data.qvel[hinge[1]]))


def hinge_axis(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Array | None:
    """Axis (3,) of the only hinge between a body and its parent, world axes; None if there is not exactly one.

    Source: MuJoCo `xaxis`.
    """
    joint = _only_hinge_joint(model, body)
    return None if joint is None else data.xaxis[joint].copy()


def only_hinge(model: mujoco.MjModel, body: int) -> tuple[int, int] | None:
    """Return the index in `qpos` and in `qvel` of a body's hinge; None unless it has exactly one."""
    joint = _only_hinge_joint(model, body)
    return None if joint is None else (int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]))


def _only_hinge_joint(model: mujoco.MjModel, body: int) -> int | None:
    first = int(model.body_jntadr[body])
    joints = range(first, first + int(model.body_jntnum[body]))
    hinges = [joint for joint in joints if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE]
    return hinges[0] if len(hinges) == 1 else None


def inertia(model: mujoco.MjModel, body: int, quaternion: Array) -> Array:
    """Inertia tensor about the centre of mass, world axes (3, 3) [kg·m²], of a body with this orientation (4,)."""
    whole, axes = np.zeros(4), np.zeros(9)
    mujoco.mju_mulQuat(whole, quaternion, model.body_iquat[body])
    mujoco.mju_quat2Mat(axes, whole)
    axes = axes.reshape(3, 3)
    return axes @ np.diag(model.body_inertia[body]) @ axes.T


def shape(model: mujoco.MjModel, body: int) -> Shape:
    """Type and bounding box of all geoms of a body, in its own frame."""
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    if count == 0:
        return Shape("compound", None)
    geoms = range(first, first + count)
    name = "compound" if count > 1 else _GEOM_TYPES.get(mujoco.mjtGeom(model.geom_type[first]), "other")
    radius = float(model.geom_size[first][0]) if name in {"sphere", "cylinder", "capsule"} else None
    boxes = [_extent(model, geom) for geom in geoms]
    if any(box is None for box in boxes):
        return Shape(name, None)
    low = np.min([box[0] for box in boxes if box is not None], axis=0)
    high = np.max([box[1] for box in boxes if box is not None], axis=0)
    return Shape(name, high - low, radius)


def _extent(model: mujoco.MjModel, geom: int) -> tuple[Array, Array] | None:
    """Corners of a geom's bounding box along the body axes; None for an infinite plane."""
    size = model.geom_size[geom]
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    axes = rotation.reshape(3, 3)
    kind = mujoco.mjtGeom(model.geom_type[geom])
    centre = model.geom_pos[geom]
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        if not (size[0] and size[1]):
            return None
        half = np.abs(axes) @ np.array([size[0], size[1], 0.0])
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        half = np.full(3, size[0])
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = np.abs(axes[:, 2]) * size[1] + size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        half = np.abs(axes[:, 2]) * size[1] + size[0] * np.sqrt(np.maximum(0.0, 1.0 - axes[:, 2] ** 2))
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        half = np.sqrt((axes**2) @ (size**2))
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        corners = centre + model.mesh_vert[first : first + count] @ axes.T
        return corners.min(axis=0), corners.max(axis=0)
    else:
        # Boxes are exact; for height fields this is the box around the engine's own bounding box.
        box = model.geom_aabb[geom]
        centre = centre + axes @ box[:3]
        half = np.abs(axes) @ box[3:]
    return centre - half, centre + half


def contact(model: mujoco.MjModel, data: mujoco.MjData, first: int, second: int) -> Contact | None:
    """The contact between any geoms of two bodies, or None if they do not touch."""
    points: list[Array] = []
    normals: list[Array] = []
    for touch in data.contact:
        bodies = (int(model.geom_bodyid[touch.geom[0]]), int(model.geom_bodyid[touch.geom[1]]))
        if touch.dist <= 0 and set(bodies) == {first, second}:
            points.append(touch.pos.copy())
            # MuJoCo's contact normal points from the first geom to the second.
            normals.append(touch.frame[:3] if bodies[0] == first else -touch.frame[:3])
    if not points:
        return None
    normal = np.sum(normals, axis=0)
    length = float(np.linalg.norm(normal))
    # Opposite normals cancel only if one body is wrapped around the other; then the first of them is used.
    normal = normal / length if length > 1e-9 else normals[0].copy()
    point = np.mean(points, axis=0)
    row = normal_row(model, data, point, normal, first, second)
    return Contact(point, normal, -float(row @ data.qvel))


def normal_row(
    model: mujoco.MjModel, data: mujoco.MjData, point: Array, normal: Array, first: int, second: int
) -> Array:
    """Jacobian row (nv,) of the separation speed of two bodies at a point, along a normal from first to second."""
    of_first, of_second = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, of_first, None, point, first)
    mujoco.mj_jac(model, data, of_second, None, point, second)
    return normal @ (of_second - of_first)


def overlaps(model: mujoco.MjModel, data: mujoco.MjData, bodies: Iterable[int]) -> dict[tuple[int, int], float]:
    """Return the greatest depth [m] of overlap of each pair of a body in `bodies` and a body outside them."""
    depths: dict[tuple[int, int], float] = {}
    if not data.ncon:
        return depths  # the engine's list of contacts takes longer to make than all the rest
    own = set(bodies)
    for touch in data.contact:
        pair = (int(model.geom_bodyid[touch.geom[0]]), int(model.geom_bodyid[touch.geom[1]]))
        if (pair[0] in own) == (pair[1] in own):
            continue
        ordered = pair if pair[0] in own else (pair[1], pair[0])
        depths[ordered] = max(depths.get(ordered, 0.0), -float(touch.dist))
    return depths
