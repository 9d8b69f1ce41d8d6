"""Expressions: one grammar, one table of functions and one compiler for laws, knobs and answers that are formulas.

A recursive-descent parser converts text to nodes, and nodes are compiled to a Python function through `ast`; the text
itself is never passed to `compile` or `eval`. A `Language` limits the length of a text and its operators, functions and
numbers. Operators have the precedence of Python. Independent of bodies, knobs and answers.
"""

import ast
import functools
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import CodeType, FunctionType, MappingProxyType
from typing import Any, NamedTuple

Compiled = Callable[..., tuple[Any, ...]]
"""Compiled expressions: takes the values of the names as positional arguments; returns a value for each expression."""
Token = tuple[str, str]
"""Kind of the token (number, name, text, sign) and its text."""
MAX_DEPTH = 30
"""Largest nesting depth of brackets, functions, signs, powers and conditions."""


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


def _floor(value: float) -> float:
    return float(math.floor(value))


FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int, int]] = {
    **{name: (getattr(math, name), 1, 1) for name in ("sqrt", "exp", "log", "tanh", "radians", "degrees")},
    **{name: (getattr(math, name), 1, 1) for name in ("sin", "cos", "tan", "asin", "acos", "atan")},
    "ln": (math.log, 1, 1),
    "abs": (math.fabs, 1, 1),
    "sign": (_sign, 1, 1),
    "floor": (_floor, 1, 1),
    "atan2": (math.atan2, 2, 2),
    "hypot": (math.hypot, 2, 20),
    "min": (min, 2, 20),
    "max": (max, 2, 20),
}
"""Name → function, smallest and largest number of arguments. Angles are in radians; `log` is the natural logarithm."""

SIGNS = frozenset("+-*/%(),<>") | {"**", "<=", ">=", "==", "!=", "if", "else", "and", "or", "not"}
"""Operators and keywords of arithmetic with conditions."""


class ExpressionError(ValueError):
    """A text is not an expression of its language, or a name is invalid; the message gives the reason."""


class Node(NamedTuple):
    """A node of the expression tree: a number, a text, a name, or an operator or function with its operands."""

    head: str
    """`number`, `text`, `name`, `negative`, `compare`, `if`, `list`, `item`, an operator or a function."""
    parts: tuple["Node", ...] = ()
    text: str = ""
    """The number, text or name as written; for a comparison, its operators."""


@dataclass(frozen=True, eq=False)
class Language:
    """The language of one kind of expression, with its parser and compiler."""

    signs: Collection[str] = SIGNS
    """Allowed operators, brackets and keywords; `[` allows lists and indexing, `'` allows texts."""
    functions: Mapping[str, tuple[Callable[..., Any], int, int]] = field(default_factory=lambda: FUNCTIONS)
    operators: Mapping[str, Callable[..., Any]] = field(default_factory=lambda: {"**": math.pow})
    """Operator → function that implements it; other operators are Python's. `negative` is unary minus."""
    number: Callable[[str], float] = float
    max_chars: int = 1000
    has_factors_side_by_side: bool = False
    """Whether `2 x` is a product (implicit multiplication)."""
    unknown: str = "the name {!r} is unknown here"
    keeps_code: bool = True
    """Whether compiled code is cached; not for texts of agents, which would evict the laws of packs."""

    def read(
        self, text: str, names: Collection[str], respell: Callable[[list[Token]], list[Token]] = list[Token]
    ) -> Node:
        """Parse an expression.

        Args:
            text: The expression.
            names: Allowed names, besides `pi`.
            respell: Function that rewrites the list of tokens before parsing.

        Raises:
            ExpressionError: The text is too long, nested too deeply, or contains a part that is not allowed.
        """
        return _Reader(respell(_tokens(text, self)), self, names).whole()

    def compiled(
        self,
        names: Sequence[str],
        results: Sequence[Node],
        let: Mapping[str, Node] = MappingProxyType({}),
        constants: Mapping[str, float] = MappingProxyType({}),
    ) -> Compiled:
        """Compile expressions to one function that computes all results.

        The function raises ArithmeticError or ValueError where a result is undefined, such as 1/0.

        Args:
            names: Names of the function's parameters, in order.
            results: Expressions whose values the function returns.
            let: Name → expression; computed first, in order.
            constants: Name → fixed value, passed as a default argument so that the code does not depend on it.

        Raises:
            ExpressionError: The expressions are too long to be compiled.
        """
        try:
            build = _code if self.keeps_code else _code.__wrapped__
            code = build(self, (*names, *constants), tuple(let.items()), tuple(results))
        except (RecursionError, MemoryError) as error:
            raise ExpressionError("it is too long") from error
        functions = {name: function for name, (function, _, _) in self.functions.items()} | dict(self.operators)
        known: dict[str, Any] = {f"{name}()": function for name, function in functions.items()}  # no name contains ()
        return FunctionType(code, known | {"__builtins__": {}, "pi": math.pi}, argdefs=tuple(constants.values()))


_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<sign>not in\b|//|\*\*|[<>=!]=|[-+*/%^()\[\],<>])"
    r"|(?P<name>[^\W\d]\w*)"
    r"|(?P<text>'[^'\\\n]*'|\"[^\"\\\n]*\"))"
)
_NOT, _COMPARISON = 3, 4
_COMPARISONS: Mapping[str, type[ast.cmpop]] = (
    {"<": ast.Lt, "<=": ast.LtE, ">": ast.Gt, ">=": ast.GtE}
    | {"==": ast.Eq, "!=": ast.NotEq, "in": ast.In, "not in": ast.NotIn}
)  # fmt: skip
_ARITHMETIC: Mapping[str, type[ast.operator]] = {
    "+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div, "%": ast.Mod,
}  # fmt: skip
_BINDING = (
    {"or": 1, "and": 2, "+": 5, "-": 5}
    | dict.fromkeys(_COMPARISONS, _COMPARISON)
    | dict.fromkeys(("*", "/", "//", "%"), 6)
)
"""Operator → binding strength. Powers bind more strongly than unary signs, and signs more strongly than products."""


def _tokens(text: str, language: Language) -> list[Token]:
    if len(text) > language.max_chars:
        raise ExpressionError(f"it has {len(text)} characters; at most {language.max_chars} are allowed")
    found, at, text = list[Token](), 0, text.rstrip()
    while at < len(text):
        token = _TOKEN.match(text, at)
        kind = (token and token.lastgroup) or ""
        part = token[kind] if token and kind else ""
        allowed = kind in {"number", "name"} or part in language.signs or (kind == "text" and "'" in language.signs)
        if token is None or not allowed:
            raise ExpressionError(f"{text[at:].strip()[:1]!r} has no meaning here")
        found.append(("sign" if part in language.signs else kind, part))
        at = token.end()
    return found


def _deeper(depth: int) -> int:
    if depth >= MAX_DEPTH:
        raise ExpressionError(f"it nests more than {MAX_DEPTH} levels")
    return depth + 1


class _Reader:
    """Recursive-descent parser of a list of tokens; its methods raise ExpressionError."""

    def __init__(self, tokens: Sequence[Token], language: Language, names: Collection[str]) -> None:
        self._tokens = (*tokens, ("end", ""))
        self._language, self._names = language, names
        self._at = 0

    def _next(self) -> Token:
        return self._tokens[self._at]

    def _take(self, *signs: str) -> str:
        """Consume the next token and return it if it is one of these signs; otherwise return an empty string."""
        kind, text = self._next()
        if kind != "sign" or text not in signs:
            return ""
        self._at += 1
        return text

    def _close(self, bracket: str) -> None:
        if not self._take(bracket):
            raise ExpressionError("a bracket is not closed")

    def whole(self) -> Node:
        value = self.expression(0)
        if self._next()[0] != "end":
            raise ExpressionError(f"{self._next()[1][:20]!r} is out of place")
        return value

    def expression(self, depth: int) -> Node:
        value = self._operation(1, depth)
        if not self._take("if"):
            return value
        condition = self._operation(1, depth)
        if not self._take("else"):
            raise ExpressionError("an `if` has no `else`")
        return Node("if", (condition, value, self.expression(_deeper(depth))))

    def _operation(self, least: int, depth: int) -> Node:
        """Parse operands joined by operators of at least the binding strength `least`, left-associatively."""
        if least <= _NOT and self._take("not"):
            value = Node("not", (self._operation(_NOT, _deeper(depth)),))
        else:
            value = self._signed(depth)
        divided = compared = False
        while True:
            kind, text = self._next()
            beside = self._language.has_factors_side_by_side and (
                kind in {"number", "name"} or (kind, text) == ("sign", "(")
            )
            sign = "*" if beside else text if kind == "sign" else ""
            binding = _BINDING.get(sign, 0)
            if binding < least:
                return value
            if beside and divided:
                raise ExpressionError(f"{text!r} may be above or below the division: write * or ( )")
            self._at += not beside
            right = self._operation(binding + 1, depth)
            divided = sign == "/" or (divided and beside)
            if binding != _COMPARISON:
                value = Node(sign, (value, right))
            elif compared:  # one node for 1 < x < 2: two nodes that share x would double the work at each level
                value = Node("compare", (*value.parts, right), f"{value.text},{sign}")
            else:
                value = Node("compare", (value, right), sign)
            compared = binding == _COMPARISON

    def _signed(self, depth: int) -> Node:
        if sign := self._take("-", "+"):
            value = self._signed(_deeper(depth))
            return Node("negative", (value,)) if sign == "-" else value
        base = self._base(depth)
        while self._take("["):
            base = Node("item", (base, self.expression(_deeper(depth))))
            self._close("]")
        return Node("**", (base, self._signed(_deeper(depth)))) if self._take("**", "^") else base

    def _base(self, depth: int) -> Node:
        if self._take("("):
            value = self.expression(_deeper(depth))
            self._close(")")
            return value
        if self._take("["):
            return Node("list", self._several("]", depth))
        kind, text = self._next()
        self._at += 1
        if kind == "number" and math.isinf(float(text)):
            raise ExpressionError("a number in it is too large")
        if kind == "name":
            return self._named(text, depth)
        if kind in {"sign", "end"}:
            raise ExpressionError("it ends too early" if kind == "end" else f"{text!r} is out of place")
        return Node(kind, text=text)

    def _several(self, bracket: str, depth: int) -> tuple[Node, ...]:
        """Parse expressions separated by commas, and the closing bracket."""
        found: list[Node] = []
        while not self._take(bracket):
            if found:
                self._close(",")
            found.append(self.expression(_deeper(depth)))
        return tuple(found)

    def _named(self, name: str, depth: int) -> Node:
        """Parse a name, or a function call."""
        before_bracket = self._next() == ("sign", "(")
        if before_bracket and name in self._language.functions:
            self._at += 1
            parts = self._several(")", depth)
            _, least, most = self._language.functions[name]
            if not least <= len(parts) <= most:
                count = f"{least} to {most} arguments" if most > least else f"{least} argument{'s' * (least > 1)}"
                raise ExpressionError(f"{name} takes {count}, not {len(parts)}")
            return Node(name, parts)
        if name in self._names or name == "pi":
            return Node("name", text=name)
        if name in self._language.functions:
            raise ExpressionError(f"write {name} with brackets, as in {name}(x)")
        if before_bracket and not self._language.has_factors_side_by_side:
            raise ExpressionError(f"there is no function {name[:40]!r}")
        raise ExpressionError(self._language.unknown.format(name[:40]))


def names_in(*nodes: Node) -> set[str]:
    """The names that expressions contain."""
    found = list(nodes)
    for node in found:
        found += node.parts  # extends the list that the loop iterates over
    return {node.text for node in found if node.head == "name"}


_BUILDERS: Mapping[str, Callable[[list[ast.expr]], ast.expr]] = {
    "or": lambda operands: ast.BoolOp(ast.Or(), operands),
    "and": lambda operands: ast.BoolOp(ast.And(), operands),
    "not": lambda operands: ast.UnaryOp(ast.Not(), operands[0]),
    "negative": lambda operands: ast.UnaryOp(ast.USub(), operands[0]),
    "if": lambda operands: ast.IfExp(*operands),
    "item": lambda operands: ast.Subscript(operands[0], operands[1], ast.Load()),
    "list": lambda operands: ast.List(operands, ast.Load()),
}


@functools.lru_cache(512)
def _code(
    language: Language, arguments: tuple[str, ...], let: tuple[tuple[str, Node], ...], results: tuple[Node, ...]
) -> CodeType:
    """Compile a lambda expression, built only from the `ast` node types used here and in the tables above."""

    def tree(node: Node) -> ast.expr:
        head, parts, text = node
        if head in {"number", "text"}:
            return ast.Constant(language.number(text) if head == "number" else text[1:-1])
        if head == "name":
            return ast.Name(text, ast.Load())
        operands = list(map(tree, parts))
        if head in language.operators or head in language.functions:
            return ast.Call(ast.Name(f"{head}()", ast.Load()), operands, [])
        if head in _ARITHMETIC:
            return ast.BinOp(operands[0], _ARITHMETIC[head](), operands[1])
        signs = [_COMPARISONS[sign]() for sign in text.split(",") if sign]
        found = ast.Compare(operands[0], signs, operands[1:]) if signs else _BUILDERS[head](operands)
        is_truth = language.number is float and head in {"compare", "not"}  # sums of bool are integers
        return ast.IfExp(found, ast.Constant(1.0), ast.Constant(0.0)) if is_truth else found

    first = [ast.NamedExpr(ast.Name(name, ast.Store()), tree(node)) for name, node in let]
    values = ast.Tuple([tree(node) for node in results], ast.Load())
    body = ast.Subscript(ast.Tuple([*first, values], ast.Load()), ast.Constant(-1), ast.Load()) if first else values
    takes = ast.arguments([], [ast.arg(name) for name in arguments], kwonlyargs=[], kw_defaults=[], defaults=[])
    whole = ast.fix_missing_locations(ast.Expression(ast.Lambda(takes, body)))
    return eval(compile(whole, "<expression>", "eval"), {}).__code__  # noqa: S307 - makes the function, runs nothing
