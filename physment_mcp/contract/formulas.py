"""Expressions of laws: sets of formulas that share names, compiled separately or together to one Python function.

Independent of the engine, bodies and files. Numbers are floats and powers are those of `math.pow`, so no expression
can build a huge integer or return a complex number.
"""

import keyword
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from physment_mcp.contract.expressions import FUNCTIONS, Compiled, ExpressionError, Language, Node, names_in

_LAWS = Language()
WRITTEN_BY_AGENTS = Language(keeps_code=False)
"""The language of laws, for texts that agents write."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")


class Formulas:
    """A set of validated expressions that share names.

    Args:
        names: Names whose values are passed to each evaluation.
        constants: Name → fixed value.
        let: Name → expression. Later expressions and the results may use the name.
        results: Field → expression of the result.
        chosen: Further names whose values are passed to each evaluation. They are validated, because the author of the
            expressions chose them.
        language: `WRITTEN_BY_AGENTS` for texts of agents.

    Raises:
        ExpressionError: An expression contains an unknown name or something that is not allowed, or a name is
            already in use.
    """

    def __init__(
        self,
        names: Collection[str],
        constants: Mapping[str, float],
        let: Mapping[str, str],
        results: Mapping[str, str],
        chosen: Collection[str] = (),
        language: Language = _LAWS,
    ) -> None:
        self._language = language
        known = {"pi", *names}
        for name in chosen:
            _refuse_name("state", name, known)
            known.add(name)
        for name in constants:
            _refuse_name(f"constants.{name}", name, known)
            known.add(name)
        self._constants = {name: float(value) for name, value in constants.items()}
        self._let: dict[str, Node] = {}
        for name, text in let.items():
            _refuse_name("let", name, known)
            self._let[name] = _read(f"let.{name}", text, known)
            known.add(name)
        self._results = {field: _read(field, text, known) for field, text in results.items()}
        self.used = names_in(*self._let.values(), *self._results.values()) & {*names, *chosen}
        """The names in `names` and `chosen` that the expressions contain."""

    @property
    def length(self) -> int:
        """Number of names, numbers, operators and functions in all expressions."""
        nodes = [*self._let.values(), *self._results.values()]
        for node in nodes:
            nodes += node.parts  # extends the list that the loop iterates over
        return len(nodes)

    def function(self, arguments: Sequence[str]) -> Compiled:
        """Compile one function that computes all results.

        The function raises ArithmeticError or ValueError where a result is undefined, such as 1/0 or the root of -1.

        Args:
            arguments: Names of the function's parameters; must contain all names in `used`.
        """
        return self._language.compiled(arguments, [*self._results.values()], self._let, self._constants)

    def join(self, number: int, part: "Part", let: dict[str, Node], constants: dict[str, float]) -> None:
        """Add these formulas to the `let` and `constants` of a joint function, under unique names."""
        own = {name: f"{name}#{number}" for name in (*self._constants, *self._let)}
        names, factor = {**part.names, **own}, f"#{number}"
        constants |= {own[name]: value for name, value in self._constants.items()} | {factor: part.factor}
        let |= {own[name]: _renamed(node, names) for name, node in self._let.items()}
        for field, node in self._results.items():
            let[f"{field}#{number}"] = Node("*", (Node("name", text=factor), _renamed(node, names)))

    def fault(self, arguments: Sequence[str], values: Sequence[float]) -> str | None:
        """Return the first field without a finite value at `values`, with the reason; None if all values are finite."""
        known, found = [*arguments], [*values]
        for name, tree in self._let.items():
            value = _value(self._language.compiled(known, [tree], {}, self._constants), found)
            if isinstance(value, str):
                return f"let.{name}: {value}"
            known.append(name)
            found.append(value)
        for field, tree in self._results.items():
            value = _value(self._language.compiled(known, [tree], {}, self._constants), found)
            if isinstance(value, str):
                return f"{field}: {value}"
        return None


class Part(NamedTuple):
    """A set of formulas as part of a joint function."""

    formulas: Formulas
    names: Mapping[str, str]
    """Name in the formulas → parameter of the joint function."""
    factor: float
    """Factor that multiplies the results of the formulas."""


class Summand(NamedTuple):
    """A term of a sum: one result of a part."""

    part: int
    """Index of the part."""
    field: str
    opposite: bool = False
    """Whether the term is subtracted."""


def joined(parts: Sequence[Part], sums: Sequence[Sequence[Summand]], arguments: Sequence[str]) -> Compiled:
    """Compile one function that computes sums of the parts' results.

    The function does the same arithmetic for all values of factors and constants, so its duration does not depend on
    them.

    Args:
        parts: Sets of formulas.
        sums: Terms of each sum.
        arguments: Names of the function's parameters.

    Raises:
        ExpressionError: The expressions are too long to be compiled.
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
    """Expression tree of a sum, evaluated from left to right; 0 if there are no terms."""
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


def _value(function: Compiled, values: Sequence[float]) -> float | str:
    """Return the value of a function, or the reason why it has no finite value."""
    try:
        (result,) = function(*values)
    except ZeroDivisionError:
        return "division by zero"
    except OverflowError:
        return "a number becomes too large"
    except ValueError:
        return "a function or a power is not defined for its arguments"
    return result if math.isfinite(result) else f"the value is {result}"


def _refuse_name(field: str, name: str, taken: Collection[str]) -> None:
    """Refuse a name that is not an identifier or is already taken."""
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        shown = repr(name[:40])
        raise ExpressionError(f"{field}: {shown} cannot be a name; use a letter, then letters, digits and single _")
    if name in FUNCTIONS or name in taken:
        raise ExpressionError(f"{field}: the name {name!r} has a meaning already")


def _read(field: str, text: str, known: Collection[str]) -> Node:
    try:
        return _LAWS.read(text, known)
    except ExpressionError as error:
        raise ExpressionError(f"{field}: {error}") from error
