"""Parses JSON values in prose that a model wrote, and locates syntax errors.

It accepts deviations from the standard that have only one possible meaning: comments, trailing commas, a missing comma
between two objects or lists, single quotes, Python's True, False and None, and numbers such as `+1`, `.5` and `1.`. It
rejects NaN and infinities, unquoted keys, arithmetic, repeated keys, and strings with line breaks.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from pydantic import JsonValue

MAX_NESTING = 64
"""Deepest accepted nesting of lists and objects."""

# No pattern here may backtrack, so that the parser takes linear time for any text.
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
class JsonSpan:
    """A list of objects, or an object, found in a text."""

    start: int
    end: int
    value: JsonValue = None
    problem: str = ""
    """Description of the syntax error at `problem_at`; empty if there is a value."""
    problem_at: int = 0


class _BrokenError(Exception):
    """A syntax error at a position of the text."""

    def __init__(self, at: int, problem: str) -> None:
        super().__init__(problem)
        self.at = at
        self.problem = problem
        self.open = 0
        """Number of lists and objects that are open at the position."""


def find_json(text: str, start: int = 0) -> Iterator[JsonSpan]:
    """Yield the outermost objects and lists of objects in a text from `start` on, valid or broken, in order.

    Lists of numbers or words are skipped. Takes linear time.
    """
    while (match := _START.search(text, start)) is not None:
        try:
            value, end = _value(text, match.start(), 0)
            found = JsonSpan(match.start(), end, value)
        except _BrokenError as error:
            # Skip the rest of a broken list, so that it is not taken for a shorter list.
            end = _end_of_broken(text, error.at, error.open)
            found = JsonSpan(match.start(), end, None, error.problem, error.at)
        yield found
        start = found.end


def read_json(text: str) -> JsonValue:
    """Parse a text that is one JSON value.

    Raises:
        ValueError: The text is not JSON, or something follows the value.
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
    character = text[at : at + 1]
    if character in {'"', "'"}:
        return _string(text, at)
    if character not in {"[", "{"}:
        return _scalar(text, at)
    try:
        return _list(text, at, depth) if character == "[" else _object(text, at, depth)
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
    """Return the position of the next item or of the closing bracket."""
    at = _skip(text, at)
    character = text[at : at + 1]
    if character == ",":
        return _skip(text, at + 1)
    if character == closing or (may_omit and character in {"[", "{"}):
        return at
    raise _BrokenError(at, f"a comma or {closing} is expected" if character else f"it breaks off before its {closing}")


def _string(text: str, at: int) -> tuple[str, int]:
    quote, start, parts = text[at], at, list[str]()
    at += 1
    while True:
        plain = _PLAIN[quote].match(text, at)
        assert plain is not None  # the pattern also matches the empty string
        parts.append(plain.group())
        at = plain.end()
        character = text[at : at + 1]
        if character == quote:
            return _joined("".join(parts)), at + 1
        if character != "\\" or text[at + 1 : at + 2] in {"", "\n"}:
            raise _BrokenError(start, "this string does not end on its line")
        escaped = text[at + 1]
        if escaped == "u":
            digits = text[at + 2 : at + 6]
            if not re.fullmatch(r"[0-9a-fA-F]{4}", digits):
                raise _BrokenError(at, r"\u is not followed by four hexadecimal digits")
            parts.append(chr(int(digits, 16)))
            at += 6
            continue
        # A backslash before any other character, such as from LaTeX, is kept literally.
        parts.append(_ESCAPES.get(escaped, escaped if escaped in "\"'\\/" else f"\\{escaped}"))
        at += 2


def _joined(text: str) -> str:
    """Combine surrogate pairs that were written as two escapes."""
    if not any("\ud800" <= character <= "\udfff" for character in text):
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
        # Python refuses to parse very long integers, and no quantity needs them.
        if len(written) > 300:
            raise _BrokenError(at, "this number has more than 300 digits")
        return int(written)
    value = float(written)
    if value in (float("inf"), float("-inf")):
        raise _BrokenError(at, "this number is too large")
    return value


def _end_of_broken(text: str, at: int, depth: int) -> int:
    """Return the end of a broken value: its closing bracket, a blank line or a code fence.

    Args:
        text: The text.
        at: Position of the syntax error.
        depth: Number of lists and objects that are open there.
    """
    while (match := _RECOVERY.search(text, at)) is not None:
        character, at = match.group(), match.end()
        if character in {"[", "{"}:
            depth += 1
        elif character in {"]", "}"}:
            depth -= 1
            # With a missing or extra bracket the count reaches 0 too early; a following comma or bracket shows this.
            if depth <= 0 and not _MORE.match(text, at):
                return at
        elif character in _PLAIN:
            at = _end_of_string(text, match.start())
        else:
            return match.start()
    return len(text)


def _end_of_string(text: str, at: int) -> int:
    """Return the end of a string, or of its line if the string is not closed on it."""
    try:
        return _string(text, at)[1]
    except _BrokenError:
        end = text.find("\n", at)
        return end if end >= 0 else len(text)
