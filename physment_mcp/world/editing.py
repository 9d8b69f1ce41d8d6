"""Edits of the model: add a ball, remove a body, join two bodies. Each works on a copy of the spec."""

import itertools
from typing import Literal

import mujoco
import numpy as np

from physment_mcp.world.engines import delete
from physment_mcp.world.readings import Array

JointKind = Literal["weld", "ball", "hinge"]

_SOLIMP = [0.999, 0.9999, 0.001, 0.5, 2.0]


def with_ball(
    spec: mujoco.MjSpec, body: str, position: Array, density: float, radius: float, rgba: Array
) -> mujoco.MjSpec:
    """A copy of `spec` with a free sphere in it."""
    edited = spec.copy()
    ball = edited.worldbody.add_body(name=body, pos=position)
    ball.add_joint(name=f"{body}_joint", type=mujoco.mjtJoint.mjJNT_FREE)
    ball.add_geom(
        name=f"{body}_geom", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], density=density, rgba=rgba
    )
    return edited


def without_body(spec: mujoco.MjSpec, body: str) -> mujoco.MjSpec:
    """A copy of `spec` without the body, the bodies jointed to it, and the constraints that refer to any of them."""
    edited = spec.copy()
    delete(edited, edited.body(body))
    return edited


def with_joint(
    spec: mujoco.MjSpec, settled: mujoco.MjData, bodies: tuple[str, str], kind: JointKind, axis: Array | None
) -> mujoco.MjSpec:
    """A copy of `spec` in which two bodies are constrained at their present relative pose.

    The constraint acts between pairs of sites, because a constraint between bodies would use the model's initial pose
    instead of the present one. A hinge is held at two points of its axis, which passes through the second body's
    origin. Contact between the two bodies is switched off, because it would work against the joint.

    Args:
        spec: The spec to copy.
        settled: Data with current poses.
        bodies: Names of the two bodies.
        kind: `weld`, or a pivot at the second body's origin: `ball`, `hinge`.
        axis: Axis of a hinge (3,), world, not zero; None for the other kinds.
    """
    edited = spec.copy()
    taken = {site.name for site in edited.sites}
    # When one of two joined bodies is deleted, the other keeps its sites, so names made of body names could repeat.
    label = next(
        label
        for label in (f"attached:{number}" for number in itertools.count())
        if not {f"{label}:0:a", f"{label}:0:b"} & taken
    )
    stiffness = _stiffness(edited)
    first, second = settled.body(bodies[0]), settled.body(bodies[1])
    to_first = first.xmat.reshape(3, 3).T
    origin = to_first @ (second.xpos - first.xpos)
    turned = np.zeros(4)
    back = np.zeros(4)
    mujoco.mju_negQuat(back, first.xquat)
    mujoco.mju_mulQuat(turned, back, second.xquat)
    points: list[Array] = [np.zeros(3)]
    if kind == "hinge" and axis is not None:
        # Scaled by its largest part first, because the norm of a tiny axis would underflow.
        direction = (scaled := axis / np.abs(axis).max()) / np.linalg.norm(scaled)
        points = [0.5 * direction, -0.5 * direction]
    equality = mujoco.mjtEq.mjEQ_WELD if kind == "weld" else mujoco.mjtEq.mjEQ_CONNECT
    to_second = second.xmat.reshape(3, 3).T
    for index, point in enumerate(points):
        names = (f"{label}:{index}:a", f"{label}:{index}:b")
        edited.body(bodies[0]).add_site(name=names[0], pos=origin + to_first @ point, quat=turned)
        edited.body(bodies[1]).add_site(name=names[1], pos=to_second @ point)
        edited.add_equality(
            name=f"{label}:{index}",
            type=equality,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=names[0],
            name2=names[1],
            solref=stiffness,
            solimp=_SOLIMP,
        )
    edited.add_exclude(name=label, bodyname1=bodies[0], bodyname2=bodies[1])
    return edited


def _stiffness(spec: mujoco.MjSpec) -> list[float]:
    """A direct `solref` (-stiffness, -damping): critically damped, and as stiff as the integrator can follow.

    MuJoCo's equality constraints do not account for the centripetal acceleration v²/r, so they give way by τ² v²/r: by
    1.9 mm for a pendulum released at the horizontal, with τ of two time steps of 5 ms. A critically damped constraint
    is stable with τ of one time step in the fourth-order Runge-Kutta method, and of 1.25 or more in the Euler methods.
    """
    steps = 1.0 if spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 2.0
    tau = steps * spec.option.timestep
    return [-1.0 / tau**2, -2.0 / tau]
