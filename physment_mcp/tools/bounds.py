"""How large a tool call may be, whatever its tool, so that none keeps the laboratory busy before it is refused."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

MAX_NAME = 64
"""Longest name of a tool, in characters."""
MAX_CALL_BYTES = 20_000
"""Most text in the arguments of a call, names and integers of more than 64 bits included [bytes of UTF-8]."""
MAX_ARGUMENTS = 32
"""Most arguments of a call."""
MAX_VALUES = 4000
"""Most values in the arguments of a call, lists and objects included."""
MAX_NESTING = 16
"""Most levels of lists and objects in the arguments of a call."""
_SHORT = MAX_NAME
"""Length of a text that is not worth counting [characters, each at most 4 bytes]."""
_FEW = 16
"""Numbers in a list that is not worth counting."""
_LONG = 2**64
"""Least size of an integer whose digits are counted as text; JSON allows thousands of them."""


def excess(name: str, arguments: Mapping[str, Any]) -> str:
    """Why a call is too large to be looked at; empty if it is not. Stops at the first bound that is exceeded.

    Args:
        name: Name of the tool, as the client wrote it.
        arguments: Values that JSON can hold.
    """
    if len(name) <= MAX_NAME and len(arguments) <= MAX_ARGUMENTS:
        for key, value in arguments.items():
            if len(key) > _SHORT or not _is_small(value):
                break
        else:
            return ""  # as most calls are; the rest takes 15 to 50 µs
    return _excess(name, arguments)


def _excess(name: str, arguments: Mapping[str, Any]) -> str:
    if len(name) > MAX_NAME:
        return f"the name of a tool has at most {MAX_NAME} characters, not {len(name)}"
    if len(arguments) > MAX_ARGUMENTS:
        return f"a call has at most {MAX_ARGUMENTS} arguments, not {len(arguments)}"
    level: list[Any] = [arguments]
    values = size = 0
    for _ in range(MAX_NESTING + 1):
        size += sum(map(_text_of, level))
        level = [part for value in level for part in _parts(value)]
        values += len(level)
        if values > MAX_VALUES:
            return f"the arguments of a call hold at most {MAX_VALUES} values"
        if size > MAX_CALL_BYTES:
            return f"the arguments of a call hold at most {MAX_CALL_BYTES} bytes of text"
        if not level:
            return ""
    return f"the arguments of a call nest at most {MAX_NESTING} levels"


def _is_small(value: Any) -> bool:
    """Whether as many such values as a call may have are within the bounds: a number, a short text, a short vector."""
    if isinstance(value, list):
        items = cast("list[Any]", value)
        return len(items) <= _FEW and all(map(_is_number, items))
    return value is None or _is_number(value) or (isinstance(value, str) and len(value) <= _SHORT)


def _is_number(value: Any) -> bool:
    """Whether a value is a number that takes no more memory than others."""
    return isinstance(value, float) or (isinstance(value, int) and -_LONG < value < _LONG)


def _text_of(value: Any) -> int:
    """Text of a value without its parts [bytes]; that of a long integer from its bits, as its digits take long."""
    if isinstance(value, str):
        return len(value.encode("utf-8", "surrogatepass"))
    return value.bit_length() * 3 // 10 if isinstance(value, int) and not -_LONG < value < _LONG else 0


def _parts(value: Any) -> Sequence[Any]:
    """What a value holds: the items of a list; the names and values of an object."""
    if isinstance(value, Mapping):
        named = cast("Mapping[Any, Any]", value)
        return [*named.keys(), *named.values()]
    return cast("list[Any]", value) if isinstance(value, list) else ()
