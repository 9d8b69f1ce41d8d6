"""The tools as text, for agents that have no native tool calls: arguments with types and units, and results."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from physment_mcp.tools.base import Tool


def tool_listing(tools: Iterable[Tool[Any]]) -> str:
    """A list with each tool's signature and description, and below it its arguments and results."""
    return "\n".join(_entry(tool) for tool in tools)


def _entry(tool: Tool[Any]) -> str:
    arguments, results = tool.input_schema(), tool.output_schema()
    required = set(arguments.get("required", ()))
    fields: Mapping[str, Any] = arguments.get("properties", {})
    defined: Mapping[str, Any] = arguments.get("$defs", {}) | results.get("$defs", {})
    signature = ", ".join(
        f"{name}: {_type(field, defined)}" + ("" if name in required else f" = {json.dumps(field.get('default'))}")
        for name, field in fields.items()
    )
    lines = [f"- `{tool.name}({signature})`: {tool.description}"]
    lines += [
        f"  - `{name}`: {field['description']}"
        for name, field in fields.items()
        if field.get("description") and name != _OBJECT
    ]
    returned = [
        f"`{name}: {_type(field, defined)}`" + (f" {field['description']}" if field.get("description") else "")
        for name, field in results.get("properties", {}).items()
        if name not in _EVERYWHERE
    ]
    return "\n".join([*lines, f"  - Returns {' · '.join(returned)}"] if returned else lines)


_OBJECT = "object_id"
"""An argument of many tools, which the prompt explains once."""
_EVERYWHERE = {"sim_time", "results"}
"""Fields of all results, or of none that says anything."""


def _type(field: Mapping[str, Any], defined: Mapping[str, Any]) -> str:
    """The type of a field, as `number`, `[number × 3]`, `{x: number, y: number}` or `string or integer`.

    Args:
        field: Its JSON Schema.
        defined: The schemas that a `$ref` may name, from `$defs`.

    Raises:
        KeyError: The schema names no type; each argument and result must have one.
    """
    if "$ref" in field:
        return _type(defined[field["$ref"].removeprefix("#/$defs/")], defined)
    if "anyOf" in field:
        return " or ".join(_type(option, defined) for option in field["anyOf"])
    if "enum" in field:
        return " or ".join(map(json.dumps, field["enum"]))
    if field["type"] == "array":
        size = (
            f" × {field['minItems']}" if field.get("minItems") == field.get("maxItems") and "minItems" in field else ""
        )
        return f"[{_type(field['items'], defined)}{size}]"
    if field.get("properties"):
        return "{" + ", ".join(f"{name}: {_type(part, defined)}" for name, part in field["properties"].items()) + "}"
    return str(field["type"])
