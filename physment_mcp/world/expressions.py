"""Expressions of laws: sets of them that share names, compiled to one Python function, alone or together.

Knows arithmetic, and no engine, bodies or files. Numbers are floats and powers are those of `math.pow`, so no
expression can build a huge integer or return a complex number.
"""

import keyword
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from physment_mcp.contract.expressions import FUNCTIONS, Compiled, ExpressionError, Language, Node, names_in

_LAWS = Language()
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")


class Formulas:
    """Some expressions that share names, checked.

    Args:
        names: Names whose values come with each evaluation.
        constants: Names with fixed values.
        let: Name → expression; the ones after it and the results may use it.
        results: Field → expression, the values that are wanted.

    Raises:
        ExpressionError: An expression contains something that is not allowed or an unknown name, or a name is taken.
    """

    def __init__(
        self, names: Collection[str], constants: Mapping[str, float], let: Mapping[str, str], results: Mapping[str, str]
    ) -> None:
        known = {"pi", *names}
        for name in constants:
            _refuse_name(f"constants.{name}", name, known)
            known.add(name)
        self._constants = {name: float(value) for name, value in constants.items()}
        self._let: dict[str, Node] = {}
        for name, text in let.items():
            self._let[name] = _read(f"let.{name}", text, known)
            _refuse_name(f"let.{name}", name, known)
            known.add(name)
        self._results = {field: _read(field, text, known) for field, text in results.items()}
        self.used = names_in(*self._let.values(), *self._results.values()) & set(names)
        """Those of `names` that the expressions contain."""

    def function(self, arguments: Sequence[str]) -> Compiled:
        """One function that computes all results from the values of `arguments`, which contain all names in use.

        It raises ArithmeticError or ValueError where a result does not exist, such as 1/0 or the root of -1.
        """
        return _LAWS.compiled(arguments, [*self._results.values()], self._let, self._constants)

    def join(self, number: int, part: "Part", let: dict[str, Node], constants: dict[str, float]) -> None:
        """Add these formulas to those of one function, under names that no others have."""
        own = {name: f"{name}#{number}" for name in (*self._constants, *self._let)}
        names, factor = {**part.names, **own}, f"#{number}"
        constants |= {own[name]: value for name, value in self._constants.items()} | {factor: part.factor}
        let |= {own[name]: _renamed(node, names) for name, node in self._let.items()}
        for field, node in self._results.items():
            let[f"{field}#{number}"] = Node("*", (Node("name", text=factor), _renamed(node, names)))

    def fault(self, arguments: Sequence[str], values: Sequence[float]) -> str | None:
        """The first field that has no finite value at `values`, and why; None if all have one."""
        let = [*self._let.items()]
        fields = [(f"let.{name}", tree, dict(let[:number])) for number, (name, tree) in enumerate(let)]
        for field, tree, before in [*fields, *((field, tree, self._let) for field, tree in self._results.items())]:
            if reason := _reason(_LAWS.compiled(arguments, [tree], before, self._constants), values):
                return f"{field}: {reason}"
        return None


class Part(NamedTuple):
    """A set of formulas beside others in one function."""

    formulas: Formulas
    names: Mapping[str, str]
    """The names of its values → those of the function's arguments."""
    factor: float
    """Multiplies its results."""


class Summand(NamedTuple):
    """A result of a part, which is added to others."""

    part: int
    """Number of the part."""
    field: str
    opposite: bool = False
    """Whether it is subtracted."""


def joined(parts: Sequence[Part], sums: Sequence[Sequence[Summand]], arguments: Sequence[str]) -> Compiled:
    """One function that computes sums of results of the parts from the values of `arguments`.

    It does the same arithmetic for every factor and every constant.

    Raises:
        ExpressionError: They are too long to be compiled.
    """
    let: dict[str, Node] = {}
    constants: dict[str, float] = {}
    try:
        for number, part in enumerate(parts):
            part.formulas.join(number, part, let, constants)
    except RecursionError as error:
        raise ExpressionError("it is too long") from error
    return _LAWS.compiled(arguments, [_sum(summands) for summands in sums], let, constants)


def _sum(summands: Sequence[Summand]) -> Node:
    """A sum from left to right; 0 for none."""
    found: Node | None = None
    for number, field, opposite in summands:
        node = Node("name", text=f"{field}#{number}")
        node = Node("negative", (node,)) if opposite else node
        found = node if found is None else Node("+", (found, node))
    return found or Node("number", text="0")


def _renamed(node: Node, names: Mapping[str, str]) -> Node:
    if node.head == "name":
        return node._replace(text=names.get(node.text, node.text))
    return node._replace(parts=tuple([_renamed(part, names) for part in node.parts])) if node.parts else node


def _reason(function: Compiled, values: Sequence[float]) -> str | None:
    """Why a function has no finite result."""
    try:
        (result,) = function(*values)
    except ZeroDivisionError:
        return "division by zero"
    except OverflowError:
        return "a number becomes too large"
    except ValueError:
        return "a function or a power is not defined for its arguments"
    return None if math.isfinite(result) else f"the value is {result}"


def _refuse_name(field: str, name: str, taken: Collection[str]) -> None:
    """Refuse a name that an author gives to a quantity if it is no plain name or has a meaning already."""
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ExpressionError(f"{field}: {name!r} cannot be a name; use a letter, then letters, digits and single _")
    if name in FUNCTIONS or name in taken:
        raise ExpressionError(f"{field}: the name {name!r} has a meaning already")


def _read(field: str, text: str, known: Collection[str]) -> Node:
    try:
        return _LAWS.read(text, known)
    except ExpressionError as error:
        raise ExpressionError(f"{field}: {error}") from error
