"""Parses calls typed by a person: `step 0.5`, `apply_force object_1 [1,0,0]`; `;` separates several calls.

The functions depend only on the text and the published tools. A typing error raises an exception with one sentence,
and no call is made.
"""

import difflib
import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from evaluator.episode.player import ANSWER, ToolDescription
from evaluator.episode.toolbox import schema_problem, schema_validator
from evaluator.records.episode import ToolCall

_WORDS = {"true": True, "yes": True, "false": False, "no": False}
_OPENING, _CLOSING = "[{", "]}"
_OBJECT = 'an object such as {"mass": 2.5}'


class TypingError(ValueError):
    """The typed text is not a call; the message says what is accepted."""


def parse_line(line: str, tools: Sequence[ToolDescription]) -> tuple[ToolCall, ...]:
    """Parse the calls of a line, in order; an empty line has none.

    A call is the name of a tool and its arguments, either in the order of `signature` or as `name=value`. If a tool has
    only one argument, and for `answer` if no argument is named, it is the rest of the line. A text must be quoted if it
    contains `;`, or if it contains spaces and is not the rest of the line.

    Raises:
        TypingError: The tool does not exist, or the arguments do not fit it.
    """
    by_name = {tool.name: tool for tool in tools}
    return tuple(_call(part, by_name) for part in _split(line, ";") if part)


def signature(tool: ToolDescription) -> str:
    """Return the typed form of a tool: `compute_force object_id mass`; `[name=default]` for optional arguments."""
    required = tool.input_schema.get("required", [])
    words = [
        name if name in required else f"[{name}={json.dumps(schema.get('default'))}]"
        for name, schema in tool.input_schema.get("properties", {}).items()
    ]
    return " ".join([tool.name, *words])


def _call(text: str, tools: Mapping[str, ToolDescription]) -> ToolCall:
    name, *rest = text.split(maxsplit=1)
    tool = tools.get(name)
    if tool is None:
        close = difflib.get_close_matches(name, tools, n=1)
        raise TypingError(f"there is no tool {name!r}{f'; do you mean {close[0]}?' if close else ''}")
    call = ToolCall(tool=name, arguments=_arguments(rest[0] if rest else "", tool))
    problem = schema_problem(schema_validator(tool.input_schema), call.arguments)
    if problem:
        raise TypingError(f"{name}: {problem}")
    return call


def _arguments(text: str, tool: ToolDescription) -> dict[str, Any]:
    schemas: dict[str, Any] = tool.input_schema.get("properties", {})
    whole = len(schemas) == 1 or (tool.name == ANSWER and not re.search(rf"\b(?:{'|'.join(schemas)})=", text))
    words = [text] if whole and text else _split(text, None)
    found: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (equals and name in schemas):
            name, value = next((name for name in schemas if name not in found), ""), word
        if not name:
            raise TypingError(f"{word!r} is too much; the form is: {signature(tool)}")
        if name in found:
            raise TypingError(f"{name} is given twice; the form is: {signature(tool)}")
        try:
            found[name] = _value(value, schemas[name])
        except TypingError as error:
            raise TypingError(f"{name}: {error}") from None
    missing = [name for name in tool.input_schema.get("required", []) if name not in found]
    if missing:
        raise TypingError(f"{missing[0]} is missing; the form is: {signature(tool)}")
    return found


def _value(text: str, schema: Mapping[str, Any]) -> Any:
    """Parse a word as a value of a type that the schema allows."""
    forms: list[Mapping[str, Any]] = schema.get("anyOf", [schema])
    kinds = {str(form.get("type")): form for form in forms}
    if text.startswith('"') or ("object" in kinds and text.startswith("{")):
        return _json(text, "a text in quotes" if text.startswith('"') else _OBJECT)
    if "null" in kinds and text.lower() in {"null", "none"}:
        return None
    if "array" in kinds and (text.startswith("[") or "string" not in kinds):
        return [_value(part, kinds["array"]["items"]) for part in _list_parts(text)]
    if "boolean" in kinds and text.lower() in _WORDS:
        return _WORDS[text.lower()]
    number = _number(text) if kinds.keys() & {"number", "integer"} else None
    if number is not None:
        return number
    if "string" in kinds:
        return text
    raise TypingError(f"{text or 'nothing'} is not {_wanted(kinds)}")


def _list_parts(text: str) -> list[str]:
    if text.startswith("[") != text.endswith("]"):
        raise TypingError(f"{text} has one bracket of two")
    inner = text.removeprefix("[").removesuffix("]")
    return _split(inner, "," if "," in inner else None)


def _number(text: str) -> float | int | None:
    """Parse a finite number such as `.5` or `+1e-3`; None if it is not one."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _json(text: str, wanted: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        raise TypingError(f"{text} is not {wanted}") from None


def _wanted(kinds: Mapping[str, Any]) -> str:
    if "boolean" in kinds:
        return "true or false"
    if "object" in kinds:
        return _OBJECT
    return "a number such as 0.5" if kinds.keys() & {"number", "integer"} else "a list such as [1,0,0]"


def _split(text: str, separator: str | None) -> list[str]:
    """Split at a separator, or at spaces if it is None, but not inside quotes and brackets.

    Raises:
        TypingError: A quote or bracket is left open, or closed twice.
    """
    parts, part, depth, quoted, escaped = list[str](), "", 0, False, False
    for character in text:
        escaped, was_escaped = quoted and character == "\\" and not escaped, escaped
        if character == '"' and not was_escaped:
            quoted = not quoted
        if not quoted:
            depth += (character in _OPENING) - (character in _CLOSING)
        if depth < 0:
            raise TypingError(f"{character} closes nothing")
        if not quoted and depth == 0 and (character.isspace() if separator is None else character == separator):
            parts.append(part)
            part = ""
        else:
            part += character
    if quoted or depth:
        raise TypingError("a quote or bracket is not closed")
    stripped = [text.strip() for text in (*parts, part)]
    return [text for text in stripped if text] if separator is None else stripped
