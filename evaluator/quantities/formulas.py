"""Finds formulas in prose: coefficients of symbols, and results with the arithmetic that precedes them.

A formula is a run of numbers, units, symbols and operators without another word; `=` and `≈` divide it into sides. A
side with a symbol is symbolic (`2 E / L`); a side of numbers alone is arithmetic (`2 · 0.88 / 0.084`).
"""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from evaluator.quantities.arithmetic import FUNCTIONS, Token, TokenKind, evaluate
from evaluator.quantities.spoken import unit_at

_MAX_TOKENS = 120
"""Largest number of tokens in a formula that is evaluated."""
_MAX_COEFFICIENT = 12
"""Largest whole number that is a coefficient: the 12 of a rod's moment of inertia."""

_SCAN = re.compile(
    r"""
      (?P<space>[ \t]+|\*\*(?!\s?[-+(0-9{])|(?<![\w)\]}])\*\*|\\[,;!]|\\q?quad\b|\$|\\[()\[\]](?=.)
        |\\(?:left|right)(?=[\\()\[\]{}|]))
    | (?P<equal>=|≈|≃|\\approx(?![a-z])|\\simeq(?![a-z]))
    | (?P<number>(?:[0-9]+(?:\.[0-9]+)?|\.[0-9]+)(?:[eE][-+−]?[0-9]{1,2}(?![0-9]))?)
    | (?P<raised>[⁰¹²³⁴⁵⁶⁷⁸⁹]+|⁻[¹²³⁴⁵⁶⁷⁸⁹]+)
    | (?P<power>\^|\*\*(?=\s?[-+(0-9{]))
    | (?P<half>[½¼¾])
    | (?P<fraction>\\[dt]?frac(?![a-z]))
    | (?P<pi>π|\\pi(?![a-z])|\bpi\b)
    | (?P<function>√|\\?(?:sin|cos|tan)(?:⁻¹|\^\{?-1\}?)(?![a-z])
        |\\?(?:sqrt|arcsin|arccos|arctan|asin|acos|atan|sin|cos|tan|exp|ln)(?![a-z]))
    | (?P<times>[*·×⋅]|\\cdot(?![a-z])|\\times(?![a-z]))
    | (?P<over>[/÷])
    | (?P<plus>\+)
    | (?P<minus>[-−–])
    | (?P<open>[(\[{])
    | (?P<close>[)\]}])
    | (?P<word>\\?[^\W\d_]+(?:_(?:\{[^{}\s]{1,12}\}|[A-Za-z0-9]+)|[0-9₀-₉]+)?['′]?)
    """,
    re.VERBOSE,
)
_OPERATORS = {
    "power": TokenKind.POWER,
    "times": TokenKind.TIMES,
    "over": TokenKind.OVER,
    "plus": TokenKind.PLUS,
    "minus": TokenKind.MINUS,
    "open": TokenKind.OPEN,
    "close": TokenKind.CLOSE,
    "equal": TokenKind.EQUAL,
}
_KINDS = {
    **_OPERATORS,
    "space": TokenKind.SPACE,
    "number": TokenKind.NUMBER,
    "raised": TokenKind.RAISED,
    "half": TokenKind.CONSTANT,
    "pi": TokenKind.CONSTANT,
    "fraction": TokenKind.FRACTION,
    "function": TokenKind.FUNCTION,
}
_INVERSE = re.compile(r"⁻¹|\^\{?-1\}?")
_HALVES = {"½": 0.5, "¼": 0.25, "¾": 0.75}
_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_TIES = {
    TokenKind.POWER,
    TokenKind.TIMES,
    TokenKind.OVER,
    TokenKind.PLUS,
    TokenKind.MINUS,
    TokenKind.EQUAL,
    TokenKind.CONSTANT,
    TokenKind.FUNCTION,
}
"""Token kinds that make a neighbouring short word a symbol."""
_OPERATIONS = {
    TokenKind.POWER,
    TokenKind.RAISED,
    TokenKind.TIMES,
    TokenKind.OVER,
    TokenKind.FUNCTION,
    TokenKind.FRACTION,
}
_RESULT = {TokenKind.NUMBER, TokenKind.UNIT, TokenKind.MINUS, TokenKind.PLUS}


class Statement(NamedTuple):
    """A result in the text, and the arithmetic that is written before it."""

    start: int
    """Position of the arithmetic."""
    result: int
    """Position of the result's first digit."""
    operands: tuple[int, ...]
    """Positions of the first digits of the numbers in the arithmetic, without coefficients."""
    squared: frozenset[int]
    """Those operands that are squared, so that their sign does not matter."""
    tokens: tuple[Token, ...]
    """The arithmetic."""

    @property
    def has_units(self) -> bool:
        """Whether a number in the arithmetic has a unit."""
        return any(token.kind is TokenKind.UNIT for token in self.tokens)

    def outcome(self, values: Mapping[int, float], *, in_si: bool) -> float | None:
        """Evaluate the arithmetic; None if it has no finite value.

        Args:
            values: Position of a number → value in its unit, to use in place of the written number.
            in_si: Whether to convert units to coherent SI; otherwise units are ignored.
        """
        tokens = [token._replace(value=values.get(token.start, token.value)) for token in self.tokens]
        return evaluate(tokens if in_si else [token for token in tokens if token.kind is not TokenKind.UNIT])


class StatedFormulas(NamedTuple):
    """Coefficients, and results with their arithmetic, in the formulas of a text."""

    coefficients: frozenset[int]
    """Positions of the first digits of numbers that belong to a formula and are not measurements."""
    statements: tuple[Statement, ...]
    """The statements in order."""


def formulas_in(text: str) -> StatedFormulas:
    """Find the coefficients and the written arithmetic in a text. Takes linear time."""
    coefficients, statements = set[int](), list[Statement]()
    for run in _runs(text):
        sides = _sides(run)
        own = _coefficients(sides)
        coefficients |= own
        statements += _statements(sides, own)
    return StatedFormulas(frozenset(coefficients), tuple(statements))


def _runs(text: str) -> Iterator[list[Token]]:
    """Yield maximal runs of adjacent tokens, without words or other characters in between."""
    for line in re.finditer(r"[^\n]+", text):
        run, end = list[Token](), line.start()
        for token in _tokens(text, line.start(), line.end()):
            if token.kind is TokenKind.BREAK or token.start != end:
                yield from [run] if len(run) > 1 else []
                run = []
            if token.kind not in {TokenKind.BREAK, TokenKind.SPACE}:
                run.append(token)
            end = token.end
        yield from [run] if len(run) > 1 else []


def _tokens(text: str, start: int, stop: int) -> Iterator[Token]:
    """Yield the tokens of a line. Other characters are skipped, which leaves a gap in the positions."""
    position, before = start, TokenKind.BREAK
    while position < stop:
        found = _SCAN.match(text, position, stop)
        if found is None:
            position, before = position + 1, TokenKind.BREAK
            continue
        token = _token(text, found, before)
        yield token
        position = token.end
        if token.kind in {TokenKind.NUMBER, TokenKind.CLOSE}:
            unit, end = unit_at(text, token.end)
            if unit is not None and end <= stop:
                yield Token(TokenKind.UNIT, token.end, end, float(unit.scale * unit.angle_scale))
                position = end
        before = token.kind if token.kind is not TokenKind.SPACE else before


def _token(text: str, found: re.Match[str], before: TokenKind) -> Token:
    name, (start, end) = str(found.lastgroup), found.span()
    value, is_whole, function, kind = 0.0, False, None, _KINDS.get(name, TokenKind.BREAK)
    if name == "number":
        value, is_whole = float(found[0].replace("−", "-")), found[0].isdecimal()
    elif name == "raised":
        value = float(found[0].translate(_RAISED))
    elif name in {"half", "pi"}:
        value = _HALVES.get(found[0], math.pi)
    elif name == "function":
        function = _function(found[0].lstrip("\\"))
    elif name == "word" and _is_symbol(text, found, before):
        kind = TokenKind.SYMBOL
    return Token(kind, start, end, value, is_whole, function)


def _function(written: str) -> Callable[[float], float]:
    name = _INVERSE.sub("", written)
    return FUNCTIONS[f"arc{name}" if name != written else name]


def _is_symbol(text: str, found: re.Match[str], before: TokenKind) -> bool:
    """Whether a short word is a symbol: it is next to an operator, or directly after a number."""
    word = found[0]
    if word.startswith("\\") or not word.isascii():
        return True
    if len(re.sub(r"[_0-9].*", "", word)) > 3:
        return False
    if before in _TIES or (before is TokenKind.NUMBER and text[found.start() - 1].isdigit()):
        return True
    after = _SCAN.match(text, _after_space(text, found.end()))
    return after is not None and str(after.lastgroup) in {"equal", "power", "times", "over", "plus", "raised"}


def _after_space(text: str, position: int) -> int:
    while text[position : position + 1] == " ":
        position += 1
    return position


def _sides(run: Sequence[Token]) -> list[list[Token]]:
    sides: list[list[Token]] = [[]]
    for token in run:
        if token.kind is TokenKind.EQUAL:
            sides.append([])
        else:
            sides[-1].append(token)
    return sides


def _is_symbolic(side: Sequence[Token]) -> bool:
    return len(side) > 1 and any(token.kind is TokenKind.SYMBOL for token in side)


def _coefficients(sides: Sequence[Sequence[Token]]) -> set[int]:
    """Return the positions of the exponents and coefficients in a chain of sides; these are not measurements.

    Only 0.5 and whole numbers up to 12 are coefficients: before a constant; on a symbolic side; and, if a symbolic side
    contains the same value, on an arithmetic side.
    """
    found = set[int]()
    for token, after in (pair for side in sides for pair in pairwise(side)):
        if token.kind is TokenKind.POWER and after.kind is TokenKind.NUMBER:
            found.add(after.start)
        if _may_be_coefficient(token) and after.kind is TokenKind.CONSTANT:
            found.add(token.start)
    values = set[float]()
    for side in sides:
        if _is_symbolic(side):
            constants = [token for token in side if _may_be_coefficient(token)]
            found.update(token.start for token in constants)
            values.update(token.value for token in constants)
            values.update(token.value for token in side if token.kind is TokenKind.CONSTANT)
    for side in sides:
        if len(side) > 1 and not _is_symbolic(side):
            found.update(
                token.start
                for token, after in zip(side, [*side[1:], None], strict=True)
                if _may_be_coefficient(token)
                and token.value in values
                and (after is None or after.kind is not TokenKind.UNIT)
            )
    return found


def _may_be_coefficient(token: Token) -> bool:
    return token.kind is TokenKind.NUMBER and (
        token.value == 0.5 or (token.is_whole and token.value <= _MAX_COEFFICIENT)
    )


def _statements(sides: Sequence[Sequence[Token]], coefficients: Collection[int]) -> Iterator[Statement]:
    """Yield each side that is a single number, with the last arithmetic side before it."""
    arithmetic: Sequence[Token] = ()
    for side in sides:
        numbers = [token for token in side if token.kind is TokenKind.NUMBER]
        is_result = len(numbers) == 1 and all(token.kind in _RESULT for token in side)
        if arithmetic and is_result and side[-1].kind in {TokenKind.NUMBER, TokenKind.UNIT}:
            yield _statement(arithmetic, numbers[0].start, coefficients)
        is_calculated = len(numbers) > 1 or any(token.kind in _OPERATIONS for token in side)
        if numbers and is_calculated and len(side) <= _MAX_TOKENS and not _is_symbolic(side):
            arithmetic = side


def _statement(side: Sequence[Token], result: int, coefficients: Collection[int]) -> Statement:
    numbers = [token for token in side if token.kind is TokenKind.NUMBER]
    operands = tuple(token.start for token in numbers if token.start not in coefficients)
    squared = {token.start for token, after in pairwise(side) if after.kind is TokenKind.RAISED and after.value == 2}
    return Statement(side[0].start, result, operands, frozenset(squared), tuple(side))
