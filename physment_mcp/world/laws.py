"""Laws bound to a model: all laws are compiled to one function that returns their forces for the engine.

A law is a function of the present state: the engine evaluates it in every stage of its integrator, and for readings.
"""

import copy
import functools
from collections.abc import Collection, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.formulas import Formulas, Part, Summand, joined
from physment_mcp.errors import SceneError
from physment_mcp.world.engines import passive_forces_act
from physment_mcp.world.readings import only_hinge
from physment_mcp.world.reentrant import Addresses, add_passive_forces, body_velocity
from physment_mcp.world.written_laws import WrittenLaw, read_laws

_KEPT = 256
"""Size of the cache of compiled formulas."""
_PLACE = ("x", "y", "z")
_MOTION = ("wx", "wy", "wz", "vx", "vy", "vz")
"""Names of velocity components, in the order of `mj_objectVelocity`."""
_HINGE = ("angle", "spin")
_APPLIED = ("push_x", "push_y", "push_z", "turn_x", "turn_y", "turn_z")
"""Names of components of applied force and torque, in the order of `xfrc_applied`."""
_FORCE = ("force[0]", "force[1]", "force[2]")
_TORQUE = ("torque[0]", "torque[1]", "torque[2]")


class _Source(NamedTuple):
    """The values of one body that laws read."""

    body: int
    massive: bool
    """Whether the body has mass, and so a centre of mass; a marker, for example, has none."""
    place: bool
    motion: bool
    hinge: tuple[int, int] | None
    """Index of the joint angle in qpos and of the joint speed in qvel; None if they are not read."""
    applied: bool
    """Whether laws read the applied force and torque on the body."""

    @property
    def arguments(self) -> list[str]:
        """Names of the values, in the order of `values`."""
        groups = ((self.place, _PLACE), (self.motion, _MOTION), (self.hinge, _HINGE), (self.applied, _APPLIED))
        return [_argument(self.body, name) for needed, names in groups if needed for name in names]

    def values(self, at: Addresses, data: mujoco.MjData) -> list[float]:
        """The values as Python floats, because a division by zero raises no exception with numpy floats."""
        values: list[float] = []
        if self.place:
            # For a body without mass, the engine does not define the centre of mass.
            places = data.xipos if self.massive else data.xpos
            values += places[self.body].tolist()
        if self.motion:
            values += body_velocity(at, self.body)
        if self.hinge is not None:
            values += (data.qpos.item(self.hinge[0]), data.qvel.item(self.hinge[1]))
        if self.applied:
            values += data.xfrc_applied[self.body].tolist()
        return values


class CheckedLaw:
    """A law whose expressions have been validated against a model.

    Raises:
        ExpressionError: An expression is not allowed.
    """

    def __init__(self, written: WrittenLaw, model: mujoco.MjModel) -> None:
        self.body = int(model.body(written.on).id)
        self.reaction = int(model.body(written.others[written.reaction]).id) if written.reaction else None
        bodies = {"": self.body, **{f"{key}_": int(model.body(name).id) for key, name in written.others.items()}}
        names: dict[str, str] = {}
        for prefix, body in bodies.items():
            groups = (*_PLACE, *_MOTION, *_APPLIED, *(_HINGE if only_hinge(model, body) else ()))
            names |= {prefix + name: _argument(body, name) for name in groups}
        parts = (written.constants, written.let, written.results)
        self.formulas = _formulas(("t", *names), *(tuple(part.items()) for part in parts))
        self.arguments = {name: names.get(name, name) for name in self.formulas.used}
        """Name of each value that the law uses → argument of the joint function."""
        self.part = Part(self.formulas, self.arguments, written.factor)


class BoundLaws:
    """The laws of one model, compiled to one function. Holds no reference to the model.

    Raises:
        ExpressionError: The laws are too long to be compiled.
    """

    def __init__(self, laws: Sequence[CheckedLaw], model: mujoco.MjModel) -> None:
        self._laws = tuple(laws)
        used = {name for law in laws for name in law.arguments.values()}
        self._sources = [source for body in range(model.nbody) if (source := _source(model, body, used)) is not None]
        self._arguments = ["t", *(name for source in self._sources for name in source.arguments)]
        self._bodies, sums = _sums(laws, model)
        self._function = joined([law.part for law in laws], sums, self._arguments)

    def act(self, at: Addresses, data: mujoco.MjData) -> None:
        """Add the forces of the laws to the passive forces. Reentrant, so it may be called from an engine callback.

        Args:
            at: Addresses of the model and of `data`.
            data: Data of the model, with positions and velocities up to date.

        Raises:
            ArithmeticError: A law has no value in this state.
            ValueError: As for ArithmeticError.
        """
        # The same arithmetic for every factor, so that the duration of a step does not reveal which laws were drawn.
        add_passive_forces(at, data, self._function(*self._state(at, data)), self._bodies)

    def fault(self, model: mujoco.MjModel, data: mujoco.MjData) -> str | None:
        """Return the first field without a finite value in this state, with the reason; None if all are finite."""
        values = dict(zip(self._arguments, self._state(Addresses.of(model, data), data), strict=True))
        for index, law in enumerate(self._laws):
            own = [values[name] for name in law.arguments.values()]
            if fault := law.formulas.fault([*law.arguments], own):
                return f"laws[{index}].{fault}"
        return None

    def _state(self, at: Addresses, data: mujoco.MjData) -> list[float]:
        """Values of the arguments."""
        values = [float(data.time)]
        for source in self._sources:
            values += source.values(at, data)
        return values


def _sums(laws: Sequence[CheckedLaw], model: mujoco.MjModel) -> tuple[list[int], list[list[Summand]]]:
    """Bodies on which loads act, and for each the summands of three components of force and three of torque."""
    bodies: list[int] = []
    sums: list[list[Summand]] = []
    rows: dict[int, int] = {}
    for number, law in enumerate(laws):
        for body, opposite in ((law.body, False), (law.reaction, True)):
            if body is None:
                continue
            if body not in rows or not _adds_exactly(model, body):
                rows[body] = len(sums)
                bodies.append(body)
                sums += [[] for _ in (*_FORCE, *_TORQUE)]
            for axis, field in enumerate(_FORCE if opposite else (*_FORCE, *_TORQUE)):
                sums[rows[body] + axis].append(Summand(number, field, opposite))
    return bodies, sums


def _adds_exactly(model: mujoco.MjModel, body: int) -> bool:
    """Whether adding the forces on a body before applying them gives bit-identical results.

    This holds if the body slides along world axes and nothing else is applied to its joints. Adding first saves most
    of the evaluation time of laws.
    """
    joints = slice(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
    dofs = slice(model.body_dofadr[body], model.body_dofadr[body] + model.body_dofnum[body])
    return (
        int(model.body_parentid[body]) == 0
        and not (model.body_parentid[1:] == body).any()
        and model.body_quat[body].tolist() == [1, 0, 0, 0]
        and bool((model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE).all())
        and bool(np.isin(model.jnt_axis[joints], (-1, 0, 1)).all())
        and not model.jnt_stiffness[joints].any()
        and not model.dof_damping[dofs].any()
        and not model.ntendon
    )


def _argument(body: int, name: str) -> str:
    """Name of the joint function's argument for a value of a body. It contains a character that no pack may use."""
    return f"{name}@{body}"


def _source(model: mujoco.MjModel, body: int, used: Collection[str]) -> _Source | None:
    """The values of a body that the used arguments refer to; None if there are none."""
    place, motion, hinge, applied = (
        any(_argument(body, name) in used for name in names) for names in (_PLACE, _MOTION, _HINGE, _APPLIED)
    )
    if not (place or motion or hinge or applied):
        return None
    massive = float(model.body_mass[body]) > 0
    return _Source(body, massive, place, motion, only_hinge(model, body) if hinge else None, applied)


@functools.lru_cache(_KEPT)
def _formulas(
    names: tuple[str, ...],
    constants: tuple[tuple[str, float], ...],
    let: tuple[tuple[str, str], ...],
    results: tuple[tuple[str, str], ...],
) -> Formulas:
    """The validated formulas of a law. Cached, because every edit of a model binds its laws again."""
    return Formulas(names, dict(constants), dict(let), dict(results))


def laws_at_start(spec: mujoco.MjSpec, model: mujoco.MjModel) -> BoundLaws | None:
    """The laws of a scene that is being loaded, compiled for its model; None if it has none.

    Raises:
        SceneError: A law names an unknown body, contains something that is not allowed, or could have no effect.
    """
    written = read_laws(spec)
    if written and not passive_forces_act(model):
        raise SceneError("the scene has laws, which cannot act because its XML disables passive forces")
    laws: list[CheckedLaw] = []
    for index, law in enumerate(written):
        if unknown := [name for name in law.bodies if not _has(model, name)]:
            raise SceneError(f"laws[{index}] on {law.on}: the model has no body {unknown[0]!r}")
        try:
            laws.append(CheckedLaw(law, model))
        except ExpressionError as error:
            raise SceneError(f"laws[{index}] on {law.on}: {error}") from error
    try:
        return BoundLaws(laws, model) if laws else None
    except ExpressionError as error:
        raise SceneError(f"the scene's laws: {error}") from error


def laws_after_edit(spec: mujoco.MjSpec, model: mujoco.MjModel) -> BoundLaws | None:
    """The laws that remain after an edit, compiled for the new model; None if there are none.

    A law is removed when a body that it names has been deleted.
    """
    laws = [CheckedLaw(law, model) for law in read_laws(spec) if all(_has(model, name) for name in law.bodies)]
    return BoundLaws(laws, model) if laws else None


def refuse_faults(laws: BoundLaws, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse laws that have no finite value at the start state.

    Raises:
        SceneError: A law has no finite value.
    """
    settled = copy.copy(data)
    mujoco.mj_fwdPosition(model, settled)
    mujoco.mj_comVel(model, settled)
    if fault := laws.fault(model, settled):
        raise SceneError(f"{fault} at the start")


def _has(model: mujoco.MjModel, body: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) >= 0
