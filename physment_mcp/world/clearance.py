"""Depths of overlap at the resolution of the instruments, so that a refusal reveals no more than readings do.

A refusal compares a depth with a limit. With the true depth, an agent could find a position to nanometres by bisecting
the radius of created balls. Rounding the depth would not prevent this, because the threshold would stay sharp.
Overlaps are therefore computed in a coarse copy of the world, in which every number is a multiple of a step:

- Bodies are at the positions that `get_position` would return, with its noise, whether or not the agent may read them.
  So a refusal contains as much information about a body as one reading of its position.
- Quantities without an instrument, such as sizes of geoms and their positions on bodies, are rounded to `FLOOR`.
- Fixtures are rounded to the resolution of positions, but to no less than `FLOOR` and no more than `COARSEST`.
"""

import copy

import mujoco
import numpy as np

from physment_mcp.world import passive, readings
from physment_mcp.world.readings import Array, Pose
from physment_mcp.world.readout import Sensors, quaternion_of, rotation_vector

FLOOR = 1e-4
"""Step [m] of quantities that are read to full precision or have no instrument.

It is the usual resolution of positions, and a tenth of the overlap that is allowed, so that rounding does not decide
whether two bodies may touch.
"""
COARSEST = 1e-3
"""Largest step [m] of fixtures. With a coarser step, positions close to a floor or wall would be refused."""


def depths(sensors: Sensors, qpos: Array, tree: list[int]) -> dict[tuple[int, int], float]:
    """Depth [m] to which each body of a tree overlaps each other body in the coarse copy of the world.

    Args:
        sensors: Instruments of the world at its present, settled state.
        qpos: Joint positions (nq,) with the tree at the position to test and all other bodies at their present ones.
        tree: Ids of the body that is placed and of all bodies jointed to it.
    """
    resolution = sensors.readout.resolution("position")
    model = _coarse(sensors.model, min(max(resolution, FLOOR), COARSEST))
    data = passive.data_of(model)
    data.qpos[:] = qpos
    data.mocap_pos[:], data.mocap_quat[:] = sensors.data.mocap_pos, sensors.data.mocap_quat
    mujoco.mj_kinematics(model, data)
    for body in range(1, model.nbody):
        # The agent knows where it puts a body, so the poses of the tree are rounded but get no noise.
        pose = readings.pose(model, data, body) if body in tree else sensors.pose(model.body(body).name)
        _put(model, data, body, _rounded(pose, resolution or FLOOR, _extent(model, body)))
    mujoco.mj_collision(model, data)
    return readings.overlaps(model, data, tree)


def _coarse(model: mujoco.MjModel, fixtures: float) -> mujoco.MjModel:
    """A copy of a model in which sizes and positions of geoms are rounded to multiples of steps [m]."""
    coarse = copy.copy(model)
    fixed = model.geom_bodyid == 0
    step = np.where(fixed, fixtures, FLOOR)[:, None]
    sizes = np.rint(model.geom_size / FLOOR) * FLOOR
    coarse.geom_size[:] = np.where(sizes > 0, sizes, model.geom_size)
    coarse.geom_pos[:] = np.rint(model.geom_pos / step) * step
    for geom in range(model.ngeom):
        angle = float(step[geom, 0]) / max(float(model.geom_rbound[geom]), FLOOR)
        coarse.geom_quat[geom] = _turned(model.geom_quat[geom], angle)
    # The engine's bounding volumes belong to the exact geoms, so they are widened by the largest rounding error.
    coarse.geom_margin[:] += 4 * (fixtures + FLOOR)
    return coarse


def _extent(model: mujoco.MjModel, body: int) -> float:
    """Return an upper bound of the distance of a body's surface from its origin [m]."""
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    reach = [
        float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
        for geom in range(first, first + count)
    ]
    return max(reach, default=FLOOR)


def _rounded(pose: Pose, step: float, extent: float) -> Pose:
    """Round a position to `step` [m], and the orientation to an angle that moves points at `extent` [m] by `step`."""
    return Pose(np.rint(pose.position / step) * step, _turned(pose.quaternion, step / max(extent, step)))


def _turned(quaternion: Array, step: float) -> Array:
    """The orientation (4,) whose rotation vector is the nearest multiple of a step [rad]."""
    return quaternion_of(np.rint(rotation_vector(quaternion) / step) * step)


def _put(model: mujoco.MjModel, data: mujoco.MjData, body: int, pose: Pose) -> None:
    """Write the pose of a body, and of its geoms, into the results of the kinematics."""
    axes, inner = np.zeros(9), np.zeros(9)
    mujoco.mju_quat2Mat(axes, pose.quaternion)
    turn = axes.reshape(3, 3)
    data.xpos[body], data.xquat[body], data.xmat[body] = pose.position, pose.quaternion, axes
    data.xipos[body] = pose.position + turn @ model.body_ipos[body]
    mujoco.mju_quat2Mat(inner, model.body_iquat[body])
    data.ximat[body] = (turn @ inner.reshape(3, 3)).ravel()
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    for geom in range(first, first + count):
        data.geom_xpos[geom] = pose.position + turn @ model.geom_pos[geom]
        mujoco.mju_quat2Mat(inner, model.geom_quat[geom])
        data.geom_xmat[geom] = (turn @ inner.reshape(3, 3)).ravel()
