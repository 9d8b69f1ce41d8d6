"""Writes the laws of a model in the language in which agents write laws (`physment_mcp.contract.stated_laws`).

A model contains its laws as text, with the sampled constants (`scenes.model`). The statement gives the acceleration of
each object; coordinates and velocities of hidden bodies become states. Constants are inserted and folded, and parts
without effect are left out.
"""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from physment_mcp.contract.expressions import FUNCTIONS, ExpressionError, Language, Node, names_in
from physment_mcp.contract.stated_laws import LOADS, PLACES, SPEEDS, StatedLaw

CATCH = "gate"
"""Name of the body whose laws catch an object at the rim of the floor. Statements omit these laws."""
_AXES = ("x", "y", "z")
_LANGUAGE = Language()
_QUANTITIES = (*PLACES, *SPEEDS, *LOADS)
_STRENGTH = {"or": 1, "and": 2, "not": 3, "compare": 4, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6, "negative": 7, "**": 8}
"""Operator → binding strength. A condition has the strength 0; numbers, names and functions need no brackets."""
_ATOM = 9


class UnstatableLawError(ValueError):
    """The motion of a model does not follow from its laws alone, so its law cannot be stated; the message says why."""


class _Body(NamedTuple):
    """A body of the model that laws can name."""

    place: tuple[float, float, float]
    """Position at the start [m]."""
    slides: frozenset[str]
    """Axes along which it slides."""
    hinged: bool
    mass: float
    inertia: float
    """Moment of inertia about the axis of the hinge [kg m²]."""


@dataclass
class _Statement:
    bodies: Mapping[str, _Body]
    forces: dict[tuple[str, str], list[Node]] = field(default_factory=dict[tuple[str, str], list[Node]])
    """Body and axis, or `angle` → summands of the force or torque on it."""
    let: dict[str, Node] = field(default_factory=dict[str, Node])

    def add(self, law: Mapping[str, Any]) -> None:
        """Add the forces of a law."""
        bodies = {"": law["on"], **{f"{key}_": body for key, body in law.get("with", {}).items()}}
        names = {
            f"{prefix}{quantity}": self.variable(body, quantity)
            for prefix, body in bodies.items()
            for quantity in _QUANTITIES
        }
        names |= {"t": Node("name", text="t"), "pi": Node("name", text="pi")}
        names |= {name: _number(float(value)) for name, value in law.get("constants", {}).items()}
        for name, text in law.get("let", {}).items():
            names[name] = self._defined(name, folded(_inserted(_LANGUAGE.read(text, names), names)))
        for kind, axes in (("force", _AXES), ("torque", ("", "", "angle"))):
            for axis, text in zip(axes, law.get(kind, ()), strict=False):
                node = folded(_inserted(_LANGUAGE.read(text, names), names))
                if axis and node != _ZERO:
                    self.forces.setdefault((law["on"], axis), []).append(node)
                    if "reaction" in law:
                        opposite = folded(Node("negative", (node,)))
                        self.forces.setdefault((law["with"][law["reaction"]], axis), []).append(opposite)

    def variable(self, body: str, quantity: str) -> Node:
        """Return the name of a quantity of a body, or its value if it does not change."""
        if body.startswith("object_"):
            return Node("name", text=f"{body}_{quantity}")
        known = self.bodies[body]
        if quantity.lstrip("v") in known.slides:
            return Node("name", text=f"{body}_{quantity}")
        return _number(known.place[_AXES.index(quantity)] if quantity in _AXES else 0.0)

    def _defined(self, name: str, node: Node) -> Node:
        """Define an auxiliary quantity, under a new name if the name is taken; return the node that refers to it."""
        if _value(node) is not None or node.head == "name":
            return node
        chosen, number = name, 1
        while chosen in FUNCTIONS or self.let.get(chosen, node) != node:
            number += 1
            chosen = f"{name}{number}"
        self.let[chosen] = node
        return Node("name", text=chosen)

    def acceleration(self, body: str, axis: str) -> Node:
        """Return the acceleration of an object along an axis, or about its hinge."""
        known = self.bodies[body]
        load, mass = ("turn_z", known.inertia) if axis == "angle" else (f"push_{axis}", known.mass)
        total = self.variable(body, load) if body.startswith("object_") else _ZERO
        for force in self.forces.get((body, axis), ()):
            total = Node("+", (total, force))
        return folded(Node("/", (total, _number(mass))))

    def written(self) -> dict[str, Any]:
        """Return the statement as JSON values."""
        found: dict[str, dict[str, Node]] = {}
        for body, known in self.bodies.items():
            if body.startswith("object_"):
                axes = [*sorted(known.slides), *(["angle"] if known.hinged else [])]
                found[body] = {axis: self.acceleration(body, axis) for axis in axes}
        states, used = self._states([node for axes in found.values() for node in axes.values()])
        let = {name: written(node) for name, node in self.let.items() if name in used}
        texts = {body: {axis: written(node) for axis, node in axes.items()} for body, axes in found.items()}
        return {
            "acceleration": texts,
            **({"let": let} if let else {}),
            **({"state": states} if states else {}),
        }

    def _states(self, results: list[Node]) -> tuple[dict[str, Any], set[str]]:
        """Return the states on which results depend, and the names that results and states contain."""
        hidden = {
            f"{body}_{rate}{axis}": (body, axis, rate)
            for body, known in self.bodies.items()
            if not body.startswith("object_")
            for axis in known.slides
            for rate in ("", "v")
        }
        states, used, nodes = dict[str, Any](), set[str](), list(results)
        for node in nodes:
            for name in names_in(node) - used:
                used.add(name)
                if name in self.let:
                    nodes.append(self.let[name])  # extends the list that the loop iterates over
                elif name in hidden:
                    body, axis, rate = hidden[name]
                    change = self.acceleration(body, axis) if rate else Node("name", text=f"{body}_v{axis}")
                    start = 0.0 if rate else self.bodies[body].place[_AXES.index(axis)]
                    states[name] = {"start": start, "rate": written(change)}
                    nodes.append(change)
        return states, used


def statement_of(mjcf: str) -> dict[str, Any]:
    """Return the law of a model as an agent would write it, without the laws that catch objects at a rim.

    Args:
        mjcf: The model's XML text, with sampled values and laws.

    Raises:
        UnstatableLawError: Something besides the laws acts on the bodies, or the laws use quantities that a statement
            cannot name.
    """
    root = ET.fromstring(mjcf)  # noqa: S314 - a model of a pack that the operator named
    statement = _Statement(dict(_bodies(root)))
    texts = [text.get("data", "") for text in root.iter("text") if text.get("name") == "laws"]
    try:
        for law in json.loads(texts[0]) if texts else ():
            if law.get("factor", 1) and CATCH not in (law["on"], *law.get("with", {}).values()):
                statement.add(law)
    except ExpressionError as error:
        raise UnstatableLawError(f"a law of the model cannot be stated: {error}") from error
    return statement.written()


_FORCES = {"stiffness", "damping", "frictionloss", "armature", "gravcomp", "fluidshape"}
"""MuJoCo attributes by which the engine applies forces that are not laws."""


def _bodies(root: ET.Element) -> Iterator[tuple[str, _Body]]:
    option = root.find("option")
    gravity = "" if option is None else option.get("gravity", "0 0 -9.81")
    others = [tag for tag in ("tendon", "equality", "actuator", "contact") if root.find(tag) is not None]
    named = [attribute for element in root.iter() for attribute in element.attrib if attribute in _FORCES]
    if others or named or any(map(float, gravity.split())) or not gravity:
        raise UnstatableLawError(f"besides the laws acts {(*others, *named, 'gravity')[0]}")
    for body in root.iter("body"):
        joints = [(joint.get("type"), joint.get("axis", "")) for joint in body.findall("joint")]
        slides = {_axis_of(axis) for kind, axis in joints if kind == "slide"}
        hinged = any(kind == "hinge" and _axis_of(axis) == "z" for kind, axis in joints)
        if len(slides) + hinged != len(joints):
            raise UnstatableLawError(f"{body.get('name')} moves otherwise than along the axes or about z")
        if any(geom.get("contype") != "0" for geom in body.findall("geom")) and joints:
            raise UnstatableLawError(f"{body.get('name')} collides")
        place = [float(part) for part in body.get("pos", "0 0 0").split()]
        mass, inertia = _masses(body)
        yield (
            body.get("name", ""),
            _Body((place[0], place[1], place[2]), frozenset(slides), hinged, mass, inertia),
        )


def _axis_of(axis: str) -> str:
    parts = [float(part) for part in axis.split()]
    if sorted(parts) != [0, 0, 1]:
        raise UnstatableLawError(f"a joint has the axis {axis}")
    return _AXES[parts.index(1)]


def _masses(body: ET.Element) -> tuple[float, float]:
    """Return the mass of a body, and its moment of inertia about z [kg m²]; 0 if the model does not state it."""
    inertial = body.find("inertial")
    if inertial is not None:
        return float(inertial.get("mass", "0")), float(inertial.get("diaginertia", "0 0 0").split()[2])
    return sum(float(geom.get("mass", "0")) for geom in body.findall("geom")), 0.0


# Folding and writing


def _number(value: float) -> Node:
    text = f"{abs(value):.7g}"
    return Node("negative", (Node("number", text=text),)) if value < 0 else Node("number", text=text)


_ZERO, _ONE = _number(0.0), _number(1.0)


def _value(node: Node) -> float | None:
    """Return the value of a number, with its sign; None for other nodes."""
    if node.head == "negative" and node.parts[0].head == "number":
        return -float(node.parts[0].text)
    return float(node.text) if node.head == "number" else None


def _inserted(node: Node, names: Mapping[str, Node]) -> Node:
    if node.head == "name":
        return names[node.text]
    return node._replace(parts=tuple(_inserted(part, names) for part in node.parts))


def folded(node: Node) -> Node:
    """Return an expression in which operations on numbers alone are computed and neutral operands left out."""
    if not node.parts:
        return _number(float(node.text)) if node.head == "number" else node
    parts = tuple(folded(part) for part in node.parts)
    node, values = node._replace(parts=parts), [_value(part) for part in parts]
    if node.head == "if" and values[0] is not None:
        return parts[1] if values[0] else parts[2]
    if None not in values and node.head != "negative":
        try:
            (result,) = _LANGUAGE.compiled([], [node])()
            return _number(float(result))
        except (ArithmeticError, ValueError):
            return node
    if node.head == "negative" and parts[0].head == "negative":
        return parts[0].parts[0]
    return _simpler(node, parts, values)


def _simpler(node: Node, parts: tuple[Node, ...], values: list[float | None]) -> Node:
    """Remove a neutral operand, such as `+ 0` or `* 1`, from an operation."""
    head, first, last = node.head, values[0], values[-1]
    if (head == "*" and 0 in values) or (head == "/" and first == 0):
        return _ZERO
    if (head == "+" and first == 0) or (head == "*" and first == 1):
        return parts[1]
    if (head in {"+", "-"} and last == 0) or (head in {"*", "/", "**"} and last == 1):
        return parts[0]
    return _ONE if head == "**" and last == 0 else node


def written(node: Node, least: int = 0) -> str:
    """Write an expression with as few brackets as its operators need.

    Args:
        node: The expression.
        least: Binding strength below which brackets are needed.
    """
    head, parts = node.head, node.parts
    if head in {"number", "name"}:
        return node.text
    strength = _STRENGTH.get(head, 0 if head == "if" else _ATOM)
    if head == "if":
        text = f"{written(parts[1], 1)} if {written(parts[0], 1)} else {written(parts[2], 0)}"
    elif head == "not":
        text = f"not {written(parts[0], strength)}"
    elif head == "negative":
        text = f"-{written(parts[0], strength)}"
    elif head == "compare":
        signs = node.text.split(",")
        rest = "".join(f" {sign} {written(part, strength + 1)}" for sign, part in zip(signs, parts[1:], strict=True))
        text = f"{written(parts[0], strength + 1)}{rest}"
    elif head == "**":
        text = f"{written(parts[0], _ATOM)}**{written(parts[1], 7)}"
    elif head in _STRENGTH:
        space = " " if strength <= 5 else ""
        text = f"{written(parts[0], strength)}{space}{head}{space}{written(parts[1], strength + 1)}"
    else:
        text = f"{head}({', '.join(written(part) for part in parts)})"
    return f"({text})" if strength < least else text


class Coordinate(NamedTuple):
    """A coordinate in which an object can move."""

    body: str
    axis: str
    """`x`, `y`, `z`, or `angle` for a hinge."""
    inertia: float
    """Mass [kg], or moment of inertia about the hinge [kg m²]."""


class LawModel(NamedTuple):
    """The true law of a scene, with the size of its laboratory."""

    statement: Mapping[str, Any]
    """The law, as an agent would state it."""
    coordinates: tuple[Coordinate, ...]
    radius: float | None
    """Distance from the middle within which objects can move [m]; None if nothing limits them."""


def law_model(mjcf: str) -> LawModel:
    """Return the law of a model, with the coordinates of its objects and the radius of its floor or rail.

    Raises:
        UnstatableLawError: As for `statement_of`, or `StatedLaw` refuses the statement, for example as too long.
    """
    root = ET.fromstring(mjcf)  # noqa: S314 - a model of a pack that the operator named
    found = tuple(
        Coordinate(name, axis, body.inertia if axis == "angle" else body.mass)
        for name, body in _bodies(root)
        if name.startswith("object_")
        for axis in (*sorted(body.slides), *(["angle"] if body.hinged else []))
    )
    sizes = [geom.get("size", "0") for geom in root.iter("geom") if geom.get("name") in {"floor", "rail"}]
    statement = statement_of(mjcf)
    try:
        StatedLaw(statement, [*statement["acceleration"]])
    except ExpressionError as error:
        raise UnstatableLawError(f"the law of the model as agents would state it is refused: {error}") from error
    return LawModel(statement, found, float(sizes[0].split()[0]) if sizes else None)
