"""Generates straight-line code (without branches) in which each common subexpression is computed once.

Expressions of the grammar share many parts, such as the speed of a body, and many of their operations contain constants
only. `Program` computes each operation once. Operations on constants and controls alone are computed once, before the
integration.
"""

import ast
from collections.abc import Iterable, Mapping
from typing import Final

_SIGNS: Final[Mapping[type[ast.operator], str]] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**",
}  # fmt: skip
_MOST_FACTORS = 4
"""Largest integer exponent that is written as a product."""


class Program:
    """A list of operations in order, each assigned to a new variable.

    Attributes:
        early: Lines that contain neither time nor state.
        late: Lines that contain time or state.
    """

    def __init__(self, changing: Iterable[str]) -> None:
        """Begin without operations.

        Args:
            changing: Names of the time and of the state variables.
        """
        self.early: list[str] = []
        self.late: list[str] = []
        self._changing = set(changing)
        self._known: dict[str, str] = {}
        self._variables: dict[str, str] = {}

    def let(self, name: str, text: str) -> None:
        """Define a name as the value of an expression."""
        self._known[name] = self.value(text)

    def value(self, text: str) -> str:
        """Add the operations of an expression; returns the variable or number that holds its value."""
        return self._of(ast.parse(text, mode="eval").body)

    def _of(self, node: ast.expr) -> str:
        match node:
            case ast.Constant():
                found = repr(node.value)
            case ast.Name():
                found = self._known.get(node.id, node.id)
            case ast.UnaryOp(ast.USub(), ast.Constant() as number):
                found = f"(-{number.value!r})"
            case ast.UnaryOp(ast.USub(), operand):
                found = self._numbered("-{}", self._of(operand))
            case ast.BinOp(base, ast.Pow(), ast.Constant(int() as exponent)) if 1 < exponent <= _MOST_FACTORS:
                found = self._power(self._of(base), exponent)
            case ast.BinOp(left, sign, right):
                found = self._numbered(f"{{}}{_SIGNS[type(sign)]}{{}}", self._of(left), self._of(right))
            case ast.Call(ast.Name(function), arguments):
                found = self._numbered(f"{function}({','.join(['{}'] * len(arguments))})", *map(self._of, arguments))
            case ast.Subscript(ast.Name(name), ast.Constant(key)):
                found = self._numbered(f"{name}[{key!r}]")
            case _:
                msg = f"no expression of the grammar: {ast.unparse(node)}"
                raise ValueError(msg)
        return found

    def _power(self, base: str, exponent: int) -> str:
        """Write a power as products, because `numpy.power` takes as long as twenty of them."""
        square = self._numbered("{}*{}", base, base)
        if exponent == 2:
            return square
        return self._numbered("{}*{}", square, base if exponent == 3 else square)

    def _numbered(self, operation: str, *operands: str) -> str:
        """Return the variable that holds the result of an operation, which is added at its first use."""
        text = operation.format(*operands)
        if text not in self._variables:
            name = self._variables[text] = f"v{len(self._variables)}"
            changes = not self._changing.isdisjoint(operands)
            if changes:
                self._changing.add(name)
            (self.late if changes else self.early).append(f"{name}={text}")
        return self._variables[text]
