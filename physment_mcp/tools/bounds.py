"""How large a tool call may be, whatever its tool, so that none keeps the laboratory busy before it is refused."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

MAX_NAME = 64
"""Longest name of a tool, in characters."""
MAX_CALL_BYTES = 20_000
"""Most text in the arguments of a call, names included [bytes of UTF-8]."""
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


def excess(name: str, arguments: Mapping[str, Any]) -> str:
    """Why a call is too large to be looked at; empty if it is not. Stops at the first bound that is exceeded.

    Args:
        name: Name of the tool, as the client wrote it.
        arguments: Values that JSON can hold; only texts, lists and objects are looked into.
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
        size += sum(len(value.encode("utf-8", "surrogatepass")) for value in level if isinstance(value, str))
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
        return len(items) <= _FEW and all(isinstance(item, int | float) for item in items)
    return value is None or isinstance(value, int | float) or (isinstance(value, str) and len(value) <= _SHORT)


def _parts(value: Any) -> Sequence[Any]:
    """What a value holds: the items of a list; the names and values of an object."""
    if isinstance(value, Mapping):
        named = cast("Mapping[Any, Any]", value)
        return [*named.keys(), *named.values()]
    return cast("list[Any]", value) if isinstance(value, list) else ()
