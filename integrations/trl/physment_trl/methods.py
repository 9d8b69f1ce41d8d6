"""Creates a typed method for each tool from its JSON schema, because TRL reads tools from signatures and docstrings.

`tools.json` is a copy of the laboratory's tools. Signatures cannot express bounds of numbers, lengths of lists and the
fields of a law; the laboratory checks them.
"""

import inspect
import json
from collections.abc import Callable
from functools import reduce
from importlib.resources import files
from operator import or_
from typing import Any, Literal

_KINDS = {"string": str, "number": float, "integer": int, "boolean": bool, "null": type(None)}

_COPY = json.loads(files(__package__).joinpath("tools.json").read_text("utf-8"))
TOOLS: tuple[dict[str, Any], ...] = tuple(_COPY["tools"])
"""The tools in their published order, each with `name`, `description` and `input_schema`."""
ANSWER_WITH_LAW: dict[str, Any] = _COPY["answer_with_law"]
"""`answer` in scenes that ask for a law."""


def method_of(tool: dict[str, Any]) -> Callable[..., str]:
    """Create a method with the signature and docstring of a tool, which passes its arguments to `_call`."""
    name, schema = tool["name"], tool["input_schema"]
    properties, required = schema["properties"], schema.get("required", ())

    def method(self: Any, **arguments: Any) -> str:
        return self._call(name, arguments)

    receiver = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parameters = [
        inspect.Parameter(
            one,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if one in required else found["default"],
            annotation=_type_of(found),
        )
        for one, found in properties.items()
    ]
    method.__name__ = name
    method.__qualname__ = f"LaboratoryEnvironment.{name}"
    method.__doc__ = _docstring(tool["description"], properties)
    method.__annotations__ = {one.name: one.annotation for one in parameters}
    method.__signature__ = inspect.Signature([receiver, *parameters])  # type: ignore[attr-defined] - read by `inspect`
    return method


def _docstring(description: str, properties: dict[str, Any]) -> str:
    said = [" ".join(description.split())]
    if properties:
        said += [
            "",
            "Args:",
            *(f"    {one}: {' '.join(found['description'].split())}" for one, found in properties.items()),
        ]
    return "\n".join(said)


def _type_of(schema: dict[str, Any]) -> Any:
    """The Python type of the values that a schema allows."""
    if "anyOf" in schema:
        return reduce(or_, map(_type_of, schema["anyOf"]))
    if "enum" in schema:
        return Literal[tuple(schema["enum"])]
    if schema["type"] == "array":
        return list[_type_of(schema["items"])]
    if schema["type"] == "object":
        values = schema["additionalProperties"]
        return dict[str, _type_of(values) if values else Any]  # False for an object with named fields
    return _KINDS[schema["type"]]
