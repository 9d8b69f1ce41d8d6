"""Evaluates arithmetic that was found in prose, from its tokens. Independent of the text and of unit names."""

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, auto
from typing import NamedTuple


class TokenKind(Enum):
    """Kind of a token."""

    NUMBER = auto()
    UNIT = auto()
    """Multiplies the number or group before it by its value, which is the factor to coherent SI."""
    CONSTANT = auto()
    SYMBOL = auto()
    FUNCTION = auto()
    FRACTION = auto()
    """Divides the first of the two following groups by the second, as in LaTeX."""
    RAISED = auto()
    """A superscript exponent; its value is the exponent."""
    POWER = auto()
    TIMES = auto()
    OVER = auto()
    PLUS = auto()
    MINUS = auto()
    OPEN = auto()
    CLOSE = auto()
    EQUAL = auto()
    SPACE = auto()
    BREAK = auto()
    """Ends a formula."""


class Token(NamedTuple):
    """A token of a formula."""

    kind: TokenKind
    start: int
    end: int
    value: float = 0.0
    is_whole: bool = False
    """Whether a number is written as a whole number."""
    function: Callable[[float], float] | None = None


FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "√": math.sqrt,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": math.asin,
    "arccos": math.acos,
    "arctan": math.atan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "exp": math.exp,
    "ln": math.log,
}
"""Functions that prose may use; angles are in radians."""

_MAX_DEPTH = 20
_STARTS = {TokenKind.NUMBER, TokenKind.CONSTANT, TokenKind.FUNCTION, TokenKind.FRACTION, TokenKind.OPEN}


def evaluate(tokens: Sequence[Token]) -> float | None:
    """Evaluate arithmetic with the usual precedence of operators; adjacent factors are multiplied.

    Returns:
        The value; None if the tokens are not valid arithmetic, or have no finite value.
    """
    reader = _Reader(tokens)
    try:
        value = reader.total()
    except (ArithmeticError, ValueError, RecursionError):
        return None
    return value if reader.is_at_end and math.isfinite(value) else None


class _Reader:
    """A recursive-descent parser; every method raises ValueError on a syntax error."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens = tokens
        self._next = 0
        self._depth = 0

    @property
    def is_at_end(self) -> bool:
        return self._next == len(self._tokens)

    @property
    def _kind(self) -> TokenKind | None:
        return None if self.is_at_end else self._tokens[self._next].kind

    def _take(self) -> Token:
        if self.is_at_end:
            raise ValueError("unfinished")
        self._next += 1
        return self._tokens[self._next - 1]

    def total(self) -> float:
        value = self._product()
        while self._kind in {TokenKind.PLUS, TokenKind.MINUS}:
            sign = 1 if self._take().kind is TokenKind.PLUS else -1
            value += sign * self._product()
        return value

    def _product(self) -> float:
        value = self._factor()
        while self._kind in {TokenKind.TIMES, TokenKind.OVER} or self._kind in _STARTS:
            if self._kind is TokenKind.OVER:
                self._take()
                value /= self._factor()
            else:
                if self._kind is TokenKind.TIMES:
                    self._take()
                value *= self._factor()
        return value

    def _factor(self) -> float:
        if self._kind in {TokenKind.PLUS, TokenKind.MINUS}:
            return (1 if self._take().kind is TokenKind.PLUS else -1) * self._factor()
        value = self._base()
        if self._kind is TokenKind.RAISED:
            return _power(value, self._take().value)
        if self._kind is TokenKind.POWER:
            self._take()
            return _power(value, self._factor())
        return value

    def _base(self) -> float:
        token = self._take()
        if token.kind is TokenKind.OPEN:
            return self._group() * self._unit()
        if token.kind is TokenKind.FRACTION:
            return self._braces() / self._braces()
        if token.kind is TokenKind.FUNCTION and token.function is not None:
            return token.function(self._factor())
        if token.kind in {TokenKind.NUMBER, TokenKind.CONSTANT}:
            return token.value * self._unit()
        raise ValueError(token.kind)

    def _unit(self) -> float:
        return self._take().value if self._kind is TokenKind.UNIT else 1.0

    def _braces(self) -> float:
        if self._take().kind is not TokenKind.OPEN:
            raise ValueError("a fraction needs two groups")
        return self._group()

    def _group(self) -> float:
        """Evaluate the remaining tokens of a group in brackets, and consume its closing bracket."""
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ValueError("too deep")
        value = self.total()
        if self._take().kind is not TokenKind.CLOSE:
            raise ValueError("a bracket is not closed")
        self._depth -= 1
        return value


def _power(base: float, exponent: float) -> float:
    value: complex = base**exponent
    if isinstance(value, complex):
        raise ValueError("a root of a negative number")  # noqa: TRY004 - as math.sqrt does
    return value
