"""Laws: forces on bodies as expressions of time and of the motion of bodies, written into the model's XML.

The element `<custom><text name="laws" data="..."/></custom>` holds a JSON list of laws, all constants drawn:

    {"on": "object_1", "with": {"other": "partner"}, "constants": {"k": 3.2},
     "let": {"r": "hypot(x - other_x, y - other_y)"},
     "force": ["-k*(x-other_x)/r**2.5", "-k*(y-other_y)/r**2.5", "0"], "torque": ["0", "0", "0"], "reaction": "other",
     "factor": 1.0}

`force` [N] and `torque` [N·m], world axes, act at the centre of mass of the body `on`. `reaction` is the key in `with`
of the body on whose centre of mass the opposite force acts; a torque has no reaction. `factor` multiplies force and
torque; a draw that leaves a law out gives it the factor 0, and it is still evaluated. Names are `t` [s]; `x y z` [m]
and `vx vy vz` [m/s] of the centre of mass; `wx wy wz` [rad/s]; for a body with exactly one hinge `angle` [rad] and
`spin` [rad/s]; the same with `other_` before them; constants; what `let` defines.

A law has no memory: the engine evaluates it in every stage of its integrator, and for readings.
"""

import copy
import functools
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco

from physment_mcp.errors import SceneError
from physment_mcp.world.engines import passive_forces_act
from physment_mcp.world.expressions import ExpressionError, Formulas
from physment_mcp.world.inside import Addresses, add_passive_force, body_velocity
from physment_mcp.world.readings import only_hinge

TEXT = "laws"
"""Name of the text element that holds the laws."""

LAW_LIMIT = 64
"""Most laws of a model."""

_KEPT = 256
"""Most laws whose compiled formulas are kept."""
_PLACE = ("x", "y", "z")
_MOTION = ("wx", "wy", "wz", "vx", "vy", "vz")
"""In the order of `mj_objectVelocity`."""
_HINGE = ("angle", "spin")
_ZERO = ("0", "0", "0")


class WrittenLaw(NamedTuple):
    """A law as in the JSON."""

    on: str
    others: Mapping[str, str]
    constants: Mapping[str, float]
    let: Mapping[str, str]
    results: Mapping[str, str]
    """`force[0]` to `torque[2]` → expression."""
    reaction: str | None
    factor: float
    """Multiplies force and torque: 0 for a law that the draw leaves out, otherwise 1."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies that it needs."""
        return (self.on, *self.others.values())


class _Source(NamedTuple):
    """What a law reads of one body."""

    body: int
    massive: bool
    """Whether it has a centre of mass; a marker, for example, has none."""
    place: bool
    motion: bool
    hinge: tuple[int, int] | None
    """Where the angle is in qpos and the spin in qvel."""


class BoundLaw:
    """A law compiled for one model. It does not keep the model alive.

    Raises:
        ExpressionError: An expression is not allowed.
    """

    def __init__(self, written: WrittenLaw, model: mujoco.MjModel) -> None:
        self._body = int(model.body(written.on).id)
        self._factor = written.factor
        self._reaction = int(model.body(written.others[written.reaction]).id) if written.reaction else None
        bodies = {"": self._body, **{f"{key}_": int(model.body(name).id) for key, name in written.others.items()}}
        hinges = {prefix: only_hinge(model, body) for prefix, body in bodies.items()}
        names = ["t"]
        for prefix, hinge in hinges.items():
            names += [prefix + name for name in (*_PLACE, *_MOTION, *(_HINGE if hinge else ()))]
        parts = (written.constants, written.let, written.results)
        self._formulas = _formulas(tuple(names), *(tuple(part.items()) for part in parts))
        self._arguments = ["t"]
        self._sources: list[_Source] = []
        for prefix, body in bodies.items():
            groups = [[prefix + name for name in group] for group in (_PLACE, _MOTION, _HINGE)]
            place, motion, hinge = (not self._formulas.used.isdisjoint(group) for group in groups)
            self._sources.append(
                _Source(body, float(model.body_mass[body]) > 0, place, motion, hinges[prefix] if hinge else None)
            )
            for group, needed in zip(groups, (place, motion, hinge), strict=True):
                self._arguments += group if needed else []
        self._function = self._formulas.function(self._arguments)

    def act(self, at: Addresses, data: mujoco.MjData) -> None:
        """Add the law's force to the passive forces. Safe inside a call of the engine.

        Args:
            at: Addresses of the model and of `data`.
            data: Of the model, with positions and velocities up to date.

        Raises:
            ArithmeticError: It has no value in this state.
            ValueError: As above.
        """
        # The same arithmetic for every factor: the time that a step takes must not tell which laws were drawn.
        load = [self._factor * part for part in self._function(*self._state(at, data))]
        add_passive_force(at, data, self._body, load)
        if self._reaction is not None:
            x, y, z = load[:3]
            add_passive_force(at, data, self._reaction, (-x, -y, -z, 0.0, 0.0, 0.0))

    def fault(self, model: mujoco.MjModel, data: mujoco.MjData) -> str | None:
        """The field that has no finite value in this state, and why."""
        return self._formulas.fault(self._arguments, self._state(Addresses.of(model, data), data))

    def _state(self, at: Addresses, data: mujoco.MjData) -> list[float]:
        """Values of the arguments, as Python's floats: with those of numpy, a division by zero would raise nothing."""
        values = [float(data.time)]
        for source in self._sources:
            if source.place:
                # The engine gives no meaning to the centre of mass of a body without mass.
                places = data.xipos if source.massive else data.xpos
                values += places[source.body].tolist()
            if source.motion:
                values += body_velocity(at, source.body)
            if source.hinge is not None:
                values += (data.qpos.item(source.hinge[0]), data.qvel.item(source.hinge[1]))
        return values


@functools.lru_cache(_KEPT)
def _formulas(
    names: tuple[str, ...],
    constants: tuple[tuple[str, float], ...],
    let: tuple[tuple[str, str], ...],
    results: tuple[tuple[str, str], ...],
) -> Formulas:
    """The formulas of a law. Kept, because every edit of a model binds its laws anew."""
    return Formulas(names, dict(constants), dict(let), dict(results))


def read_laws(spec: mujoco.MjSpec) -> tuple[WrittenLaw, ...]:
    """The laws in a model's text element; none if it has no such element.

    Raises:
        SceneError: The text is not in the format.
    """
    texts = [text.data for text in spec.texts if text.name == TEXT]
    if not texts:
        return ()
    try:
        listed = json.loads(texts[0])
    except ValueError as error:
        raise SceneError("the scene's laws are no JSON") from error
    if not isinstance(listed, list) or len(listed) > LAW_LIMIT:
        raise SceneError(f"the scene's laws must be a list of at most {LAW_LIMIT}")
    return tuple(_written(f"laws[{index}]", law) for index, law in enumerate(listed))


def laws_at_start(spec: mujoco.MjSpec, model: mujoco.MjModel) -> tuple[BoundLaw, ...]:
    """The laws of a scene that is being loaded, compiled for its model.

    Raises:
        SceneError: A law names an unknown body, contains what is not allowed, or could not act.
    """
    written = read_laws(spec)
    if written and not passive_forces_act(model):
        raise SceneError("the scene has laws, which cannot act because its XML disables passive forces")
    laws: list[BoundLaw] = []
    for index, law in enumerate(written):
        if unknown := [name for name in law.bodies if not _has(model, name)]:
            raise SceneError(f"laws[{index}] on {law.on}: the model has no body {unknown[0]!r}")
        try:
            laws.append(BoundLaw(law, model))
        except ExpressionError as error:
            raise SceneError(f"laws[{index}] on {law.on}: {error}") from error
    return tuple(laws)


def laws_after_edit(spec: mujoco.MjSpec, model: mujoco.MjModel) -> tuple[BoundLaw, ...]:
    """The laws that remain after an edit, compiled for the new model.

    A law ceases when a body that it names has been deleted.
    """
    return tuple(BoundLaw(law, model) for law in read_laws(spec) if all(_has(model, name) for name in law.bodies))


def refuse_faults(laws: tuple[BoundLaw, ...], model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse laws that have no finite value at the start.

    Raises:
        SceneError: One has none.
    """
    settled = copy.copy(data)
    mujoco.mj_fwdPosition(model, settled)
    mujoco.mj_comVel(model, settled)
    for index, law in enumerate(laws):
        if fault := law.fault(model, settled):
            raise SceneError(f"laws[{index}].{fault} at the start")


def _written(where: str, law: Any) -> WrittenLaw:
    fields = {"on", "with", "constants", "let", "force", "torque", "reaction", "factor"}
    if not isinstance(law, dict) or not set(law) <= fields or not isinstance(law.get("on"), str):
        raise SceneError(f"{where} must be an object with `on` and some of {', '.join(sorted(fields - {'on'}))}")
    others, let = law.get("with", {}), law.get("let", {})
    for field, value in (("with", others), ("let", let)):
        if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
            raise SceneError(f"{where}.{field} must be an object whose values are texts")
    if any(not key.isascii() or not key.isidentifier() for key in others):
        raise SceneError(f"{where}.with: a key must be a plain name, because it becomes a prefix")
    if "force" not in law and "torque" not in law:
        raise SceneError(f"{where} has neither `force` nor `torque`")
    results: dict[str, str] = {}
    for field in ("force", "torque"):
        axes = law.get(field, _ZERO)
        if not isinstance(axes, list | tuple) or [type(text) for text in axes] != [str] * 3:
            raise SceneError(f"{where}.{field} must be a list of three expressions")
        results |= {f"{field}[{axis}]": text for axis, text in enumerate(axes)}
    reaction = law.get("reaction")
    if reaction is not None and reaction not in others:
        raise SceneError(f"{where}.reaction must be a key of `with`")
    constants, factor = _numbers(where, law)
    return WrittenLaw(law["on"], others, constants, let, results, reaction, factor)


def _numbers(where: str, law: Mapping[str, Any]) -> tuple[dict[str, float], float]:
    """The constants of a law, and its factor."""
    constants, factor = law.get("constants", {}), law.get("factor", 1.0)
    if not isinstance(constants, dict) or not all(map(_is_number, constants.values())):
        raise SceneError(f"{where}.constants must be an object whose values are finite numbers")
    if not _is_number(factor):
        raise SceneError(f"{where}.factor must be a finite number")
    return {name: float(value) for name, value in constants.items()}, float(factor)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and abs(value) < 1e300


def _has(model: mujoco.MjModel, body: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) >= 0
