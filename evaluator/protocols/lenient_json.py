"""JSON as models write it in prose: values found in any text, with the place where a broken one breaks.

Beyond the standard: comments, trailing commas, a comma forgotten between two objects or lists, single quotes, Python's
True, False and None, and numbers such as `+1`, `.5` and `1.`. Each has one possible meaning. Not read: NaN and
infinities, unquoted keys, arithmetic, repeated keys, strings that run over a line end. Knows nothing of calls.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from pydantic import JsonValue

MAX_NESTING = 64
"""Levels of lists and objects that are read."""

# No pattern here may backtrack: a megabyte of anything must be read in the time it takes to look at it.
_START = re.compile(r"""\[(?=\s*+\{)|\{(?=\s*+(?:["']|tool\b|name\b|function\b))""")
_GAP = re.compile(r"(?:\s++|//[^\n]*+|/\*[^*\n]*+\*/)*+")
_NUMBER = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?+|\.\d++)(?:[eE][+-]?\d++)?+(?![\w.])", re.ASCII)
_WORD = re.compile(r"\w+")
_PLAIN = {'"': re.compile(r'[^"\\\n]*'), "'": re.compile(r"[^'\\\n]*")}
_RECOVERY = re.compile(r"""[\[\]{}"']|```|\n[ \t\r]*\n""")
_MORE = re.compile(r"[ \t\r]*+(?:\n[ \t\r]*+)?[,:\]}]")
_WORDS = {"true": True, "false": False, "null": None, "True": True, "False": False, "None": None}
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t"}


@dataclass(frozen=True, slots=True)
class Found:
    """A list of objects, or an object, that stands in a text."""

    start: int
    end: int
    value: JsonValue = None
    problem: str = ""
    """What is wrong at `problem_at`; then there is no value."""
    problem_at: int = 0


class _BrokenError(Exception):
    """The text is no JSON from here on."""

    def __init__(self, at: int, problem: str) -> None:
        super().__init__(problem)
        self.at = at
        self.problem = problem
        self.open = 0
        """How many lists and objects are open there."""


def find_json(text: str, start: int = 0) -> Iterator[Found]:
    """All lists of objects and objects in a text from `start` on, whole or broken, outermost only, in order.

    A bare list of numbers or words is none of them. Takes time in proportion to the length of the text.
    """
    while (match := _START.search(text, start)) is not None:
        try:
            value, end = _value(text, match.start(), 0)
            found = Found(match.start(), end, value)
        except _BrokenError as error:
            # The rest of a broken list must not pass for a shorter list of its own.
            end = _end_of_broken(text, error.at, error.open)
            found = Found(match.start(), end, None, error.problem, error.at)
        yield found
        start = found.end


def read_json(text: str) -> JsonValue:
    """The value that a text consists of.

    Raises:
        ValueError: It is no JSON, or something follows it.
    """
    try:
        value, end = _value(text, _skip(text, 0), 0)
    except _BrokenError as error:
        raise ValueError(error.problem) from None
    if _skip(text, end) != len(text):
        raise ValueError("something follows the JSON")
    return value


def _skip(text: str, at: int) -> int:
    match = _GAP.match(text, at)
    return match.end() if match else at


def _value(text: str, at: int, depth: int) -> tuple[JsonValue, int]:
    if depth > MAX_NESTING:
        raise _BrokenError(at, f"more than {MAX_NESTING} levels of lists and objects")
    sign = text[at : at + 1]
    if sign in {'"', "'"}:
        return _string(text, at)
    if sign not in {"[", "{"}:
        return _scalar(text, at)
    try:
        return _list(text, at, depth) if sign == "[" else _object(text, at, depth)
    except _BrokenError as error:
        error.open += 1
        raise


def _list(text: str, at: int, depth: int) -> tuple[JsonValue, int]:
    items: list[JsonValue] = []
    at = _skip(text, at + 1)
    while text[at : at + 1] != "]":
        item, at = _value(text, at, depth + 1)
        items.append(item)
        at = _after_item(text, at, "]", may_omit=text[at - 1] in "]}")
    return items, at + 1


def _object(text: str, at: int, depth: int) -> tuple[JsonValue, int]:
    members: dict[str, JsonValue] = {}
    at = _skip(text, at + 1)
    while text[at : at + 1] != "}":
        if text[at : at + 1] not in {'"', "'"}:
            raise _BrokenError(at, "a name in quotes is expected" if at < len(text) else "it breaks off in an object")
        key_at = at
        key, at = _string(text, at)
        if key in members:
            raise _BrokenError(key_at, f"the name {key!r} is given twice in one object")
        at = _skip(text, at)
        if text[at : at + 1] != ":":
            raise _BrokenError(at, f"a colon is expected after {key!r}")
        members[key], at = _value(text, _skip(text, at + 1), depth + 1)
        at = _after_item(text, at, "}", may_omit=False)
    return members, at + 1


def _after_item(text: str, at: int, closing: str, *, may_omit: bool) -> int:
    """Where the next item or the closing bracket stands."""
    at = _skip(text, at)
    sign = text[at : at + 1]
    if sign == ",":
        return _skip(text, at + 1)
    if sign == closing or (may_omit and sign in {"[", "{"}):
        return at
    raise _BrokenError(at, f"a comma or {closing} is expected" if sign else f"it breaks off before its {closing}")


def _string(text: str, at: int) -> tuple[str, int]:
    quote, start, parts = text[at], at, list[str]()
    at += 1
    while True:
        plain = _PLAIN[quote].match(text, at)
        assert plain is not None  # the pattern fits nothing too
        parts.append(plain.group())
        at = plain.end()
        sign = text[at : at + 1]
        if sign == quote:
            return _joined("".join(parts)), at + 1
        if sign != "\\" or text[at + 1 : at + 2] in {"", "\n"}:
            raise _BrokenError(start, "this string does not end on its line")
        escaped = text[at + 1]
        if escaped == "u":
            digits = text[at + 2 : at + 6]
            if not re.fullmatch(r"[0-9a-fA-F]{4}", digits):
                raise _BrokenError(at, r"\u is not followed by four hexadecimal digits")
            parts.append(chr(int(digits, 16)))
            at += 6
            continue
        # A backslash before any other sign is what LaTeX leaves in a string: it stands for itself.
        parts.append(_ESCAPES.get(escaped, escaped if escaped in "\"'\\/" else f"\\{escaped}"))
        at += 2


def _joined(text: str) -> str:
    """Text whose halves of surrogate pairs, written one by one, are joined."""
    if not any("\ud800" <= sign <= "\udfff" for sign in text):
        return text
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")


def _scalar(text: str, at: int) -> tuple[JsonValue, int]:
    number = _NUMBER.match(text, at)
    if number is not None:
        return _number(number.group(), at), number.end()
    word = _WORD.match(text, at)
    if word is not None and word.group() in _WORDS:
        return _WORDS[word.group()], word.end()
    raise _BrokenError(at, "this is no JSON value" if at < len(text) else "it breaks off where a value is expected")


def _number(written: str, at: int) -> int | float:
    if re.fullmatch(r"[+-]?\d+", written):
        # Python refuses to read longer integers, and no quantity needs them.
        if len(written) > 300:
            raise _BrokenError(at, "this number has more than 300 digits")
        return int(written)
    value = float(written)
    if value in (float("inf"), float("-inf")):
        raise _BrokenError(at, "this number is too large")
    return value


def _end_of_broken(text: str, at: int, depth: int) -> int:
    """Where a value that broke at `at`, `depth` levels deep, ends: at its bracket, a blank line or a fence."""
    while (match := _RECOVERY.search(text, at)) is not None:
        sign, at = match.group(), match.end()
        if sign in {"[", "{"}:
            depth += 1
        elif sign in {"]", "}"}:
            depth -= 1
            # A bracket forgotten or too many ends the count early, but not the list: a comma or bracket tells.
            if depth <= 0 and not _MORE.match(text, at):
                return at
        elif sign in _PLAIN:
            at = _end_of_string(text, match.start())
        else:
            return match.start()
    return len(text)


def _end_of_string(text: str, at: int) -> int:
    """The end of a string, or of the line if it does not end on it."""
    try:
        return _string(text, at)[1]
    except _BrokenError:
        end = text.find("\n", at)
        return end if end >= 0 else len(text)
