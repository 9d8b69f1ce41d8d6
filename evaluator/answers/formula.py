"""Reads a formula that an agent wrote, with a grammar of our own, and computes its values. Runs no text as code.

A formula has numbers, the variables of the scene, `pi`, the signs + - * / ^ (or **), brackets and the functions below.
Factors may stand side by side (`2 x`), except after a division, where `1/2 x` could mean two things. Everything is
computed in floating point, so no power can grow into a huge integer.
"""

import math
import random
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from evaluator.answers.forms import unlabel
from scenes.answer_spec import Variable

MAX_CHARS = 300
"""Longer formulas are not read."""
_MAX_DEPTH = 30
_POINTS = 64
FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "ln": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "tanh": math.tanh,
    "abs": math.fabs,
}
"""Functions of one argument; angles in radians, `log` is natural."""

_OPERATORS: Mapping[str, Callable[[float, float], float]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "^": math.pow,
}
_SIGNS = str.maketrans({"·": "*", "×": "*", "⋅": "*", "÷": "/", "−": "-", "–": "-", "π": " pi ", "√": " sqrt "})
_RAISED = re.compile(r"[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)"
    r"|(?P<name>[^\W\d]\w*)|(?P<sign>\*\*|[-+*/^()]))"
)


_LATEX = (
    (re.compile(r"\\(?:left|right)(?![a-z])|\\[()\[\]]"), ""),
    (re.compile(r"\\[,;: ]"), " "),
    (re.compile(r"\\(?:cdot|times)(?![a-z])"), "*"),
    (re.compile(r"\\(pi|sin|cos|tan|exp|ln|log)(?![a-z])"), r" \1 "),
    (re.compile(r"\\sqrt\s*\{([^{}]*)\}"), r" sqrt(\1)"),
    (re.compile(r"\^\s*\{([^{}]*)\}"), r"^(\1)"),
    (re.compile(r"_\s*\{(\w+)\}"), r"_\1"),
    (re.compile(r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}"), r" ((\1)/(\2))"),
)
_ARGUMENTS = re.compile(r"^([^\W\d]\w{0,12}) ?\([\w, ]*\) ?=")
"""The left side of `F(x, v) = 2 x v`."""


class FormulaError(ValueError):
    """The text is no formula in the variables of the scene."""


class Node(NamedTuple):
    """A part of a formula: a number, a name, or an operator or function with its operands."""

    head: str
    """`number`, `name`, one of `+ - * / ^`, `negative`, or a function."""
    parts: tuple["Node", ...] = ()
    text: str = ""
    """The number or the name as written."""


def one_side(text: str, variables: Collection[str]) -> str:
    """What stands on the right of `F = 2 x` or `The answer is 2 x`, with the usual LaTeX as plain text.

    A text whose left side is a variable of the scene is an equation, and stays as it is.
    """
    text = text.strip().removesuffix(".")
    for mark in ("**", "`", "$$", "$"):
        if len(text) > 2 * len(mark) and text.startswith(mark) and text.endswith(mark):
            text = text[len(mark) : -len(mark)].strip()
    for command, meaning in _LATEX:
        text = command.sub(meaning, text)
    label, rest = unlabel(_ARGUMENTS.sub(r"\1 =", text))
    is_equation = "=" in rest or text.startswith("-") or label.lower() in {name.lower() for name in variables}
    return text if is_equation else rest


def parse_formula(text: str, variables: Collection[str], *, run_together: bool = False) -> Node:
    """Read a formula.

    Args:
        text: The formula.
        variables: The names of the variables.
        run_together: Whether `xv` is read as `x v`, if it is no variable itself and there is only one way to read it.

    Raises:
        FormulaError: It is none, has another name in it, or is too long.
    """
    if len(text) > MAX_CHARS:
        raise FormulaError(f"longer than {MAX_CHARS} characters")
    tokens = _tokens(_RAISED.sub(lambda found: f"^({found[0].translate(_LOWERED)})", text.translate(_SIGNS)))
    reader = _Reader(_divided(tokens, variables) if run_together else tokens, variables)
    formula = reader.sum(0)
    reader.end()
    return formula


def _tokens(text: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    at = 0
    text = text.rstrip()
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None or token.lastgroup is None:
            raise FormulaError(f"{text[at:].strip()[:1]!r} has no meaning in a formula")
        found.append((token.lastgroup, token[token.lastgroup]))
        at = token.end()
    return found


def _divided(tokens: Sequence[tuple[str, str]], variables: Collection[str]) -> list[tuple[str, str]]:
    """The tokens with each unknown name replaced by the variables of which it consists."""
    found: list[tuple[str, str]] = []
    in_exponent = False
    for kind, text in tokens:
        # `2^xv` could be 2^(x v) as well as 2^x v, so a name is not divided in an exponent.
        is_known = text in variables or text in FUNCTIONS or text == "pi" or in_exponent
        ways = [] if kind != "name" or is_known else _ways(text, {*variables, "pi"})
        found += [("name", part) for part in ways[0]] if len(ways) == 1 else [(kind, text)]
        in_exponent = text in {"^", "**"} or (in_exponent and text in {"+", "-"})
    return found


def _ways(text: str, names: Collection[str]) -> list[tuple[str, ...]]:
    """At most two ways to write a text as names one after the other."""
    ways: list[list[tuple[str, ...]]] = [[()], *([] for _ in text)]
    for end in range(1, len(text) + 1):
        for name in names:
            start = end - len(name)
            if start >= 0 and text[start:end] == name:
                ways[end] = (ways[end] + [(*way, name) for way in ways[start]])[:2]
    return ways[-1]


class _Reader:
    """Reads tokens from left to right, by the usual order of operations."""

    def __init__(self, tokens: Sequence[tuple[str, str]], variables: Collection[str]) -> None:
        self._tokens = tokens
        self._variables = variables
        self._at = 0

    def _next(self) -> tuple[str, str]:
        return self._tokens[self._at] if self._at < len(self._tokens) else ("end", "")

    def _sign(self, *signs: str) -> str:
        """Take one of these signs; empty if the next token is none of them."""
        kind, text = self._next()
        if kind != "sign" or text not in signs:
            return ""
        self._at += 1
        return text

    def end(self) -> None:
        kind, text = self._next()
        if kind != "end":
            raise FormulaError(f"{text!r} is out of place")

    def sum(self, depth: int) -> Node:
        if depth > _MAX_DEPTH:
            raise FormulaError(f"nests more than {_MAX_DEPTH} levels")
        value = self._product(depth)
        while sign := self._sign("+", "-"):
            value = Node(sign, (value, self._product(depth)))
        return value

    def _product(self, depth: int) -> Node:
        value, divided = self._signed(depth), False
        while True:
            sign = self._sign("*", "/")
            kind, text = self._next()
            beside = not sign and (kind in {"number", "name"} or (kind, text) == ("sign", "("))
            if not sign and not beside:
                return value
            if beside and divided:
                raise FormulaError(f"it is not clear whether {text!r} is above or below the division: write * or ( )")
            value = Node(sign or "*", (value, self._signed(depth)))
            divided = sign == "/" or (divided and not sign)

    def _signed(self, depth: int) -> Node:
        sign = self._sign("-", "+")
        if not sign:
            return self._power(depth)
        if depth > _MAX_DEPTH:
            raise FormulaError(f"nests more than {_MAX_DEPTH} levels")
        value = self._signed(depth + 1)
        return Node("negative", (value,)) if sign == "-" else value

    def _power(self, depth: int) -> Node:
        base = self._base(depth)
        if self._sign("^", "**"):
            return Node("^", (base, self._signed(depth + 1)))
        return base

    def _base(self, depth: int) -> Node:
        kind, text = self._next()
        if self._sign("("):
            value = self.sum(depth + 1)
            if not self._sign(")"):
                raise FormulaError("a bracket is not closed")
            return value
        self._at += 1
        if kind == "number":
            return Node("number", text=text)
        if kind == "name" and (text in self._variables or text == "pi"):
            return Node("name", text=text)
        if kind == "name" and text in FUNCTIONS:
            if self._next() != ("sign", "("):
                raise FormulaError(f"write {text} with brackets, as in {text}(x)")
            return Node(text, (self._base(depth + 1),))
        if kind == "name":
            raise FormulaError(f"{text!r} is no variable of the scene")
        raise FormulaError("it ends too early" if kind == "end" else f"{text!r} is out of place")


def value_of(formula: Node, values: Mapping[str, float]) -> float | None:
    """The value of a formula; None if it has no finite real value there."""
    try:
        value = _value(formula, values)
    except (ArithmeticError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _value(formula: Node, values: Mapping[str, float]) -> float:
    head, parts, text = formula
    if head == "number":
        return float(text)
    if head == "name":
        return math.pi if text == "pi" and text not in values else values[text]
    first, *rest = (_value(part, values) for part in parts)
    if rest:
        return _OPERATORS[head](first, rest[0])
    return -first if head == "negative" else FUNCTIONS[head](first)


def points_of(variables: Mapping[str, Variable]) -> list[dict[str, float]]:
    """The points at which two formulas are compared: the corners' diagonal, and uniform draws; always the same."""
    source = random.Random("formula")  # noqa: S311 - reproducible points, not a secret
    low, high = ({name: variable.range[end] for name, variable in variables.items()} for end in (0, 1))
    drawn = [
        {name: low[name] + (high[name] - low[name]) * source.random() for name in variables} for _ in range(_POINTS)
    ]
    return [low, high, *drawn]
