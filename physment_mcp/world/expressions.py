"""Expressions of laws: checked against a list of what is allowed, then compiled to one Python function.

Knows arithmetic, and no engine, bodies or files. Numbers are floats and powers are those of `math.pow`, so no
expression can build a huge integer or return a complex number.
"""

import ast
import keyword
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from physment_mcp.parsing import PARSING

Function = Callable[..., tuple[float, ...]]
"""Takes the state by position, returns one number for each result."""

LENGTH_LIMIT = 1000
"""Most characters of an expression."""


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


def _floor(value: float) -> float:
    return float(math.floor(value))


_FUNCTIONS: dict[str, tuple[Callable[..., float], int, int]] = {
    "abs": (math.fabs, 1, 1),
    "min": (min, 2, 20),
    "max": (max, 2, 20),
    "sqrt": (math.sqrt, 1, 1),
    "exp": (math.exp, 1, 1),
    "log": (math.log, 1, 1),
    "sin": (math.sin, 1, 1),
    "cos": (math.cos, 1, 1),
    "tan": (math.tan, 1, 1),
    "asin": (math.asin, 1, 1),
    "acos": (math.acos, 1, 1),
    "atan": (math.atan, 1, 1),
    "atan2": (math.atan2, 2, 2),
    "tanh": (math.tanh, 1, 1),
    "hypot": (math.hypot, 2, 20),
    "sign": (_sign, 1, 1),
    "floor": (_floor, 1, 1),
}
"""Name → function, least and greatest number of its arguments."""

_POWER = "_power"
_CALLABLE = {name: function for name, (function, _, _) in _FUNCTIONS.items()} | {_POWER: math.pow}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")
_SIGNS = (
    *(ast.UAdd, ast.USub, ast.Not),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Mod),
    *(ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq),
)
"""Operators that are allowed, besides powers."""


class ExpressionError(Exception):
    """An expression or a name that is not allowed: its field, and the reason."""


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
        known = {"pi": ast.Constant(math.pi), **{name: ast.Name(name, ast.Load()) for name in names}}
        for name in constants:
            _refuse_name(f"constants.{name}", name, known)
            known[name] = ast.Name(name, ast.Load())
        self._constants = {name: float(value) for name, value in constants.items()}
        self._let: dict[str, ast.expr] = {}
        for name, text in let.items():
            self._let[name] = _parse(f"let.{name}", text, known)
            _refuse_name(f"let.{name}", name, known)
            known[name] = ast.Name(name, ast.Load())
        self._results = {field: _parse(field, text, known) for field, text in results.items()}
        trees = (*self._let.values(), *self._results.values())
        self.used = {node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)} & set(names)
        """Those of `names` that the expressions contain."""
        self._functions: dict[tuple[str, ...], Function] = {}

    def function(self, arguments: Sequence[str]) -> Function:
        """One function that computes all results from the values of `arguments`, which contain all names in use.

        It raises ArithmeticError or ValueError where a result does not exist, such as 1/0 or the root of -1.
        """
        wanted = tuple(arguments)
        if wanted not in self._functions:
            self._functions[wanted] = _compiled(wanted, self._constants, self._let, tuple(self._results.values()))
        return self._functions[wanted]

    def fault(self, arguments: Sequence[str], values: Sequence[float]) -> str | None:
        """The first field that has no finite value at `values`, and why; None if all have one."""
        before: dict[str, ast.expr] = {}
        for name, tree in self._let.items():
            if reason := _reason(_compiled(arguments, self._constants, before, (tree,)), values):
                return f"let.{name}: {reason}"
            before[name] = tree
        for field, tree in self._results.items():
            if reason := _reason(_compiled(arguments, self._constants, before, (tree,)), values):
                return f"{field}: {reason}"
        return None


def _reason(function: Function, values: Sequence[float]) -> str | None:
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
    if name in _FUNCTIONS or name in taken:
        raise ExpressionError(f"{field}: the name {name!r} has a meaning already")


def _parse(field: str, text: str, known: Mapping[str, ast.expr]) -> ast.expr:
    """The checked tree of an expression; `known` gives the node that each name becomes."""
    if len(text) > LENGTH_LIMIT:
        raise ExpressionError(f"{field}: it has {len(text)} characters; at most {LENGTH_LIMIT} are allowed")
    try:
        with PARSING:
            parsed = ast.parse(text, mode="eval")
        return _Checker(known).visit(parsed.body)
    except ExpressionError as error:
        raise ExpressionError(f"{field}: {error}") from error
    except (SyntaxError, ValueError) as error:
        raise ExpressionError(f"{field}: {text[:40]!r} is no expression") from error
    except (RecursionError, MemoryError) as error:
        raise ExpressionError(f"{field}: it is nested too deeply") from error


def _compiled(
    arguments: Sequence[str],
    constants: Mapping[str, float],
    let: Mapping[str, ast.expr],
    results: Sequence[ast.expr],
) -> Function:
    """The function of the results. Constants are its last arguments, so its code is the same whatever was drawn."""
    with PARSING:
        source = ast.parse(f"def law({', '.join((*arguments, *constants))}): pass")
    function = source.body[0]
    assert isinstance(function, ast.FunctionDef)
    function.body = [
        *(ast.Assign([ast.Name(name, ast.Store())], tree) for name, tree in let.items()),
        ast.Return(ast.Tuple(list(results), ast.Load())),
    ]
    namespace: dict[str, Any] = {"__builtins__": {}, **_CALLABLE}
    # Nothing but nodes that `_Checker` made, and names that `_refuse_name` let pass, is executed.
    exec(compile(ast.fix_missing_locations(source), "<law>", "exec"), namespace)  # noqa: S102 - as just said
    namespace["law"].__defaults__ = tuple(constants.values())
    return namespace["law"]


class _Checker(ast.NodeTransformer):
    """Makes the tree that is compiled: floats for numbers and constants, a function for powers; refuses all else."""

    def __init__(self, known: Mapping[str, ast.expr]) -> None:
        self._known = known

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise ExpressionError(f"the value {str(node.value)[:20]!r} is not allowed")
        try:
            number = float(node.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ExpressionError("a number in it is too large")
        return ast.Constant(number)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id not in self._known:
            raise ExpressionError(f"the name {node.id!r} is unknown here")
        return self._known[node.id]

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        _refuse_sign(node.op)
        return ast.UnaryOp(node.op, self.visit(node.operand))

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        left, right = self.visit(node.left), self.visit(node.right)
        if isinstance(node.op, ast.Pow):
            return ast.Call(ast.Name(_POWER, ast.Load()), [left, right], [])
        _refuse_sign(node.op)
        return ast.BinOp(left, node.op, right)

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        for sign in node.ops:
            _refuse_sign(sign)
        return ast.Compare(self.visit(node.left), node.ops, [self.visit(other) for other in node.comparators])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        return ast.BoolOp(node.op, [self.visit(value) for value in node.values])

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        return ast.IfExp(self.visit(node.test), self.visit(node.body), self.visit(node.orelse))

    def visit_Call(self, node: ast.Call) -> ast.expr:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in _FUNCTIONS:
            raise ExpressionError(f"there is no function {ast.unparse(node.func)[:40]!r}")
        if node.keywords:
            raise ExpressionError("an argument with a keyword is not allowed")
        _, least, most = _FUNCTIONS[name]
        if not least <= len(node.args) <= most:
            raise ExpressionError(f"{name} takes {least} to {most} arguments, not {len(node.args)}")
        return ast.Call(ast.Name(name, ast.Load()), [self.visit(argument) for argument in node.args], [])

    def generic_visit(self, node: ast.AST) -> ast.AST:
        raise ExpressionError(f"it contains what is not allowed ({type(node).__name__})")


def _refuse_sign(sign: ast.AST) -> None:
    if not isinstance(sign, _SIGNS):
        raise ExpressionError(f"it contains an operator that is not allowed ({type(sign).__name__})")
