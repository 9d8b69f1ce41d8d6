"""The format of laws in the model's XML: forces on bodies as expressions of time and of the motion of bodies.

The element `<custom><text name="laws" data="..."/></custom>` holds a JSON list of laws with the sampled values of their
constants:

    {"on": "object_1", "with": {"other": "partner"}, "constants": {"k": 3.2},
     "let": {"r": "hypot(x - other_x, y - other_y)"},
     "force": ["-k*(x-other_x)/r**2.5", "-k*(y-other_y)/r**2.5", "0"], "torque": ["0", "0", "0"], "reaction": "other",
     "factor": 1.0}

`force` [N] and `torque` [N·m], world axes, act at the centre of mass of the body `on`. `reaction` is the key in `with`
of the body on whose centre of mass the opposite force acts; a torque has no reaction. `factor` multiplies force and
torque; a law that is disabled at a seed has the factor 0 and is still evaluated. Names are `t` [s]; `x y z` [m]
and `vx vy vz` [m/s] of the centre of mass; `wx wy wz` [rad/s]; for a body with exactly one hinge `angle` [rad] and
`spin` [rad/s]; `push_x push_y push_z` [N] and `turn_x turn_y turn_z` [N·m], the applied force and torque on the body;
the same with `other_` before them; constants; what `let` defines.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco

from physment_mcp.errors import SceneError

TEXT = "laws"
"""Name of the text element that holds the laws."""

LAW_LIMIT = 64
"""Largest number of laws in a model."""

_ZERO = ("0", "0", "0")


class WrittenLaw(NamedTuple):
    """A law as written in the JSON list."""

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
        """Names of all bodies that the law refers to."""
        return (self.on, *self.others.values())


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
