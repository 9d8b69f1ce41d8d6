"""Calls as a person types them: `step 0.5`, `apply_force object_1 [1,0,0]`, several separated by `;`.

Pure: text and published tools in, calls out. What is mistyped is refused here with a sentence, before it is a call.
"""

import difflib
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from evaluator.episode.player import ToolDescription
from evaluator.episode.schemas import first_problem, schema_validator
from evaluator.records import ToolCall

_WORDS = {"true": True, "yes": True, "false": False, "no": False}
_OPENING, _CLOSING = "[{", "]}"


class TypingError(ValueError):
    """What was typed is no call; one sentence that says what would be."""


def parse_line(line: str, tools: Sequence[ToolDescription]) -> tuple[ToolCall, ...]:
    """The calls of a line, in order; none if it is empty.

    A call is a tool's name and its arguments in the order of `signature`, or as `name=value`. A tool with one argument
    takes all that follows its name. Text needs quotes only where it holds `;`, or spaces among other arguments.

    Raises:
        TypingError: There is no such tool, or its arguments do not fit.
    """
    by_name = {tool.name: tool for tool in tools}
    return tuple(_call(part, by_name) for part in _split(line, ";") if part)


def signature(tool: ToolDescription) -> str:
    """How a tool is typed: `compute_force object_id mass`, what may be left out in brackets with its default."""
    needed = tool.input_schema.get("required", [])
    words = [
        name if name in needed else f"[{name}={json.dumps(one.get('default'))}]"
        for name, one in tool.input_schema.get("properties", {}).items()
    ]
    return " ".join([tool.name, *words])


def _call(text: str, tools: Mapping[str, ToolDescription]) -> ToolCall:
    name, *rest = text.split(maxsplit=1)
    tool = tools.get(name)
    if tool is None:
        close = difflib.get_close_matches(name, tools, n=1)
        raise TypingError(f"there is no tool {name!r}{f'; do you mean {close[0]}?' if close else ''}")
    call = ToolCall(tool=name, arguments=_arguments(rest[0] if rest else "", tool))
    problem = first_problem(schema_validator(tool.input_schema), call.arguments)
    if problem:
        raise TypingError(f"{name}: {problem}")
    return call


def _arguments(text: str, tool: ToolDescription) -> dict[str, Any]:
    schemas: dict[str, Any] = tool.input_schema.get("properties", {})
    words = [text] if len(schemas) == 1 and text else _split(text, None)
    found: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (equals and name in schemas):
            name, value = next((one for one in schemas if one not in found), ""), word
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
    """What a word means where a schema says what may stand there."""
    forms: list[Mapping[str, Any]] = schema.get("anyOf", [schema])
    kinds = {str(one.get("type")): one for one in forms}
    if text.startswith('"'):
        return _json(text)
    if "null" in kinds and text.lower() in {"null", "none"}:
        return None
    if "array" in kinds and (text.startswith("[") or "string" not in kinds):
        if text.startswith("[") != text.endswith("]"):
            raise TypingError(f"{text} has one bracket of two")
        inner = text.removeprefix("[").removesuffix("]")
        parts = _split(inner, "," if "," in inner else None)
        return [_value(part, kinds["array"]["items"]) for part in parts]
    if "boolean" in kinds and text.lower() in _WORDS:
        return _WORDS[text.lower()]
    number = _number(text) if kinds.keys() & {"number", "integer"} else None
    if number is not None:
        return number
    if "string" in kinds:
        return text
    raise TypingError(f"{text or 'nothing'} is not {_wanted(kinds)}")


def _number(text: str) -> float | int | None:
    """A finite number as people write it, `.5` and `+1e-3` included; None if it is none."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        raise TypingError(f"{text} is not a text in quotes") from None


def _wanted(kinds: Mapping[str, Any]) -> str:
    if "boolean" in kinds:
        return "true or false"
    return "a number" if kinds.keys() & {"number", "integer"} else "a list such as [1,0,0]"


def _split(text: str, separator: str | None) -> list[str]:
    """The parts between separators, or between spaces if None; not within quotes and brackets.

    Raises:
        TypingError: A quote or bracket is left open, or closed twice.
    """
    parts, part, depth, quoted, escaped = list[str](), "", 0, False, False
    for sign in text:
        escaped, was_escaped = quoted and sign == "\\" and not escaped, escaped
        if sign == '"' and not was_escaped:
            quoted = not quoted
        if not quoted:
            depth += (sign in _OPENING) - (sign in _CLOSING)
        if depth < 0:
            raise TypingError(f"{sign} closes nothing")
        if not quoted and depth == 0 and (sign.isspace() if separator is None else sign == separator):
            parts.append(part)
            part = ""
        else:
            part += sign
    if quoted or depth:
        raise TypingError("a quote or bracket is not closed")
    stripped = [one.strip() for one in (*parts, part)]
    return [one for one in stripped if one] if separator is None else stripped
