"""Places bodies and gives them velocities, as far as their joints allow. Modifies only its array arguments."""

import mujoco
import numpy as np

from physment_mcp.errors import NotPossible
from physment_mcp.world.loading import joint_slices
from physment_mcp.world.readings import Array, twist

_RANK = 1e-9
"""Singular values below this threshold count as directions in which the joints cannot move the body."""


def driving_body(model: mujoco.MjModel, body: int) -> int:
    """The body whose joints move `body`: itself, or the ancestor it is rigidly fixed to; 0 if nothing moves it."""
    return int(model.body_weldid[body])


def own_joints(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints that connect the driving body to its parent."""
    driver = driving_body(model, body)
    first, count = int(model.body_jntadr[driver]), int(model.body_jntnum[driver])
    return list(range(first, first + count)) if driver and count else []


def place(model: mujoco.MjModel, settled: mujoco.MjData, qpos: Array, body: int, target: Array) -> None:
    """Write into `qpos` the joint positions that bring the body's origin as near to `target` as its joints allow.

    Args:
        model: The compiled model.
        settled: Data whose positions are current.
        qpos: Joint positions (nq,), changed in place.
        body: The body to place.
        target: World position (3,) [m].

    Raises:
        NotPossible: The body has no joint along which it could be moved.
    """
    joints = own_joints(model, body)
    shift = target - settled.xpos[body]
    if len(joints) == 1 and model.jnt_type[joints[0]] == mujoco.mjtJoint.mjJNT_FREE:
        positions, _ = joint_slices(model, joints[0])
        qpos[positions.start : positions.start + 3] += shift
        return
    slides = [joint for joint in joints if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE]
    if not slides:
        raise NotPossible("it has no free or sliding joint, so it cannot be moved to another place")
    axes = np.array([settled.xaxis[joint] for joint in slides]).T
    travel = np.linalg.lstsq(axes, shift, rcond=_RANK)[0]
    for joint, distance in zip(slides, travel, strict=True):
        address = int(model.jnt_qposadr[joint])
        qpos[address] += distance
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
            qpos[address] = np.clip(qpos[address], low, high)


def velocity_rates(model: mujoco.MjModel, settled: mujoco.MjData, body: int, velocity: Array) -> Array:
    """Joint rates (nv,) that give the body's centre of mass a velocity, as near as its own joints allow.

    A free body keeps its spin. Rates of other joints change as little as possible (least squares, minimum norm).

    Raises:
        NotPossible: No joint of the body can move its centre of mass.
    """
    joints = own_joints(model, body)
    rates = settled.qvel.copy()
    change = velocity - twist(model, settled, body).linear
    if len(joints) == 1 and model.jnt_type[joints[0]] == mujoco.mjtJoint.mjJNT_FREE:
        _, dofs = joint_slices(model, joints[0])
        # The first three rates of a free joint are the origin's velocity in world axes: with the spin kept,
        # origin and centre of mass change by the same amount.
        rates[dofs.start : dofs.start + 3] += change
        return rates
    columns = [dof for joint in joints for dof in range(model.nv)[joint_slices(model, joint)[1]]]
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacBodyCom(model, settled, jacobian, None, body)
    own = jacobian[:, columns]
    if not columns or np.linalg.norm(own) < _RANK:
        raise NotPossible("none of its joints can move its centre of mass")
    rates[columns] += np.linalg.lstsq(own, change, rcond=_RANK)[0]
    return rates


def elastic_rates(model: mujoco.MjModel, settled: mujoco.MjData, row: Array) -> tuple[Array, float]:
    """Joint rates after the perfectly elastic impulse along a separation row, and the impulse [N·s].

    p = −2 v / (J A Jᵀ), where A is the inverse mass matrix with the active equality constraints projected out:
    A = M⁻¹ − M⁻¹ Eᵀ (E M⁻¹ Eᵀ)⁺ E M⁻¹. So welds, ropes and gears transmit the impulse as if they were rigid.

    Args:
        model: The compiled model.
        settled: Data after `mj_forward`.
        row: Jacobian row (nv,) of the separation speed.

    Raises:
        NotPossible: Neither body can move along the row.
    """
    response = _inverse_mass(model, settled, row)
    equalities = _equality_rows(model, settled)
    if len(equalities):
        through = np.array([_inverse_mass(model, settled, equality) for equality in equalities])
        response = response - through.T @ np.linalg.pinv(equalities @ through.T, hermitian=True) @ (through @ row)
    compliance = float(row @ response)
    if compliance < _RANK:
        raise NotPossible("neither of the two can move along the normal of their contact")
    impulse = -2.0 * float(row @ settled.qvel) / compliance
    return settled.qvel + response * impulse, impulse


def _inverse_mass(model: mujoco.MjModel, settled: mujoco.MjData, row: Array) -> Array:
    result = np.zeros((1, model.nv))
    mujoco.mj_solveM(model, settled, result, row.reshape(1, -1))
    return result[0]


def _equality_rows(model: mujoco.MjModel, settled: mujoco.MjData) -> Array:
    """Constraint Jacobian rows (n, nv) of the active equalities."""
    chosen = np.flatnonzero(settled.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    if not mujoco.mj_isSparse(model):
        return settled.efc_J.reshape(settled.nefc, model.nv)[chosen]
    rows = np.zeros((len(chosen), model.nv))
    for place_in_rows, index in enumerate(chosen):
        first, count = int(settled.efc_J_rowadr[index]), int(settled.efc_J_rownnz[index])
        columns = settled.efc_J_colind[first : first + count]
        rows[place_in_rows, columns] = settled.efc_J[first : first + count]
    return rows
