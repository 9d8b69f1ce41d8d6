"""Edits of the model: add a ball, remove a body, join two bodies. Each works on a copy of the spec."""

import itertools
from typing import Literal

import mujoco
import numpy as np

from physment_mcp.world.loading import compiled_copy
from physment_mcp.world.readings import Array

JointKind = Literal["weld", "ball", "hinge"]

_SOLIMP = [0.999, 0.9999, 0.001, 0.5, 2.0]


def with_ball(
    spec: mujoco.MjSpec, body: str, position: Array, density: float, radius: float, rgba: Array
) -> mujoco.MjSpec:
    """A copy of `spec` with a free sphere in it."""
    edited = compiled_copy(spec)
    ball = edited.worldbody.add_body(name=body, pos=position)
    ball.add_joint(name=f"{body}_joint", type=mujoco.mjtJoint.mjJNT_FREE)
    ball.add_geom(
        name=f"{body}_geom", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], density=density, rgba=rgba
    )
    return edited


def without_body(spec: mujoco.MjSpec, body: str) -> mujoco.MjSpec:
    """A copy of `spec` without the body, what is jointed to it, and the constraints that refer to any of it."""
    edited = compiled_copy(spec)
    edited.detach_body(edited.body(body))
    return edited


def with_joint(
    spec: mujoco.MjSpec, settled: mujoco.MjData, bodies: tuple[str, str], kind: JointKind, axis: Array | None
) -> mujoco.MjSpec:
    """A copy of `spec` in which two bodies are constrained at their present relative pose.

    Pairs of sites carry the joint, because a constraint between bodies is fixed at the model's initial pose and
    not at the present one. A hinge is held at two points of its axis, which passes through the second body's origin.
    Contact between the two is switched off: it would fight the joint.

    Args:
        spec: The spec to copy.
        settled: Data with current poses.
        bodies: Names of the two bodies.
        kind: `weld`, or a pivot at the second body's origin: `ball`, `hinge`.
        axis: Hinge axis (3,) in the world, not zero; None otherwise.
    """
    edited = compiled_copy(spec)
    taken = {site.name for site in edited.sites}
    # Sites outlive a joint whose other body was deleted, so names of bodies would repeat.
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
        # Scaling by the largest part first keeps the norm of a tiny axis from underflowing.
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
    """The engine's direct `solref`, -stiffness and -damping, critically damped, as stiff as the integrator can follow.

    MuJoCo's equality constraints know nothing of the centripetal acceleration v²/r and give way by τ² v²/r under it:
    1.9 mm for a pendulum let go at the horizontal and τ of two 5 ms steps. A critically damped constraint is stable
    in the fourth-order Runge-Kutta method with τ of one time step, in the Euler methods not below 1.25.
    """
    steps = 1.0 if spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 2.0
    tau = steps * spec.option.timestep
    return [-1.0 / tau**2, -2.0 / tau]
