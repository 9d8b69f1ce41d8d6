"""The tools that a server publishes, the validation of calls and results, and the views attached to results.

A view describes what is visible in the scene. It is attached to the result of a call; records hold only the result's
text and content. Reading a view does not count as a call.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import anyio
import mcp_types as types
from jsonschema import Draft202012Validator, ValidationError
from jsonschema.exceptions import best_match  # pyright: ignore[reportUnknownVariableType] - partly typed
from mcp import Client, MCPError
from mcp.client import ClientExtension, advertise
from pydantic import JsonValue
from referencing import Registry

from evaluator.episode.player import ToolDescription
from evaluator.records.episode import ToolCall
from physment_mcp.contract.names import APP_TYPE, APPS, VIEW, VIEW_URI

_LONGEST = 300
"""Largest number of characters quoted from a validation error."""


def schema_validator(schema: Mapping[str, Any]) -> Draft202012Validator:
    """Build a validator for one schema. References outside the schema are not resolved."""
    return Draft202012Validator(dict(schema), registry=Registry())


def schema_problem(validator: Draft202012Validator, value: JsonValue) -> str:
    """Return the most specific validation error of a value and its location; empty if the value is valid."""
    problems: Iterator[ValidationError] = validator.iter_errors(value)  # pyright: ignore[reportUnknownMemberType] - partly typed
    problem = cast("ValidationError | None", best_match(problems))
    if problem is None:
        return ""
    where = ".".join(str(part) for part in problem.absolute_path)
    return f"{where + ': ' if where else ''}{problem.message[:_LONGEST]}"


def arguments_problem(validator: Draft202012Validator, call: ToolCall) -> str:
    """Explain why the arguments of a call do not fit the schema of its tool; empty if they fit."""
    try:
        json.dumps(call.arguments, allow_nan=False)
    except ValueError:
        return f"{call.tool}: the arguments must be JSON, without NaN or infinities"
    problem = schema_problem(validator, call.arguments)
    return f"{call.tool}: {problem}" if problem else ""


_SHOWN = 64
"""Largest number of characters quoted from an unknown tool name."""
_Schemas = Mapping[str, Draft202012Validator]
Look = Callable[[types.CallToolResult], None]
"""Callback with the unmodified result of a call, for viewers."""


@dataclass(frozen=True, slots=True)
class Toolbox:
    """The tools of a server. Episodes share one toolbox, because 26 schemas take thousands of Python objects."""

    tools: tuple[ToolDescription, ...]
    _arguments: _Schemas
    _results: _Schemas
    """Validators of results; empty for a server of this package, whose results and schemas have the same source."""
    _look: Look | None = None

    def misfit(self, call: ToolCall) -> str:
        """Explain why a call does not fit the published schema of its tool; empty if it fits."""
        validator = self._arguments.get(call.tool)
        if validator is None:
            return f"there is no tool {call.tool[:_SHOWN]!r}"
        return arguments_problem(validator, call)

    async def run(self, client: Client, call: ToolCall) -> types.CallToolResult:
        """Run a call on the server, and validate its result unless the server is trusted.

        The MCP client could validate it too, but would compile the schema again for each connection.

        Raises:
            MCPError: The server refused the request.
            ValueError: The result does not fit the published schema.
        """
        asked = types.CallToolRequest(params=types.CallToolRequestParams(name=call.tool, arguments=call.arguments))
        result = await client.session.send_request(asked, types.CallToolResult)
        validator = None if result.is_error else self._results.get(call.tool)
        if validator is not None:
            problem = schema_problem(validator, result.structured_content)
            if problem:
                raise ValueError(f"the result is not what the server publishes: {problem}")
        if self._look is not None:
            self._look(result)
        return result


@dataclass(slots=True)
class Toolboxes:
    """Requests the list of tools of one server, and caches it for the clients of each scene while the server allows.

    Each server needs its own instance, because two servers may publish different tools. Two scenes of one server may
    also have different tools: in some scenes, `answer` has a parameter for a law. Scenes with equal tools share one
    toolbox.
    """

    clock: Callable[[], float] = time.monotonic
    """Monotonic clock [s]."""
    trusted: bool = False
    """Whether results are not validated, because this process started the server from this package."""
    look: Look | None = None
    _lock: anyio.Lock = field(default_factory=anyio.Lock, repr=False)
    _alike: bool = True
    """Whether all replies of the server so far allowed clients to share the list of tools."""
    _kept: dict[int, tuple[Toolbox, float]] = field(default_factory=dict[int, tuple[Toolbox, float]])
    """Scene → its tools, and until when they are fresh."""
    _listed: list[tuple[Sequence[types.Tool], Toolbox]] = field(
        default_factory=list[tuple[Sequence[types.Tool], Toolbox]], repr=False
    )
    """The different lists of tools so far, each with its toolbox."""

    async def of(self, client: Client, scene: int = 0) -> Toolbox:
        """Return the tools of the server that a client is connected to.

        Args:
            client: The client.
            scene: The scene that is open; 0 if the tools of the server do not depend on it.

        Raises:
            MCPError: The server refused to list them.
        """
        if not self._alike:
            return _toolbox((await client.list_tools()).tools, self.look, checked=not self.trusted)
        async with self._lock:
            kept = self._kept.get(scene)
            if kept is not None and self.clock() < kept[1]:
                return kept[0]
            asked_at = self.clock()
            listed = await client.list_tools()
            self._alike = listed.cache_scope == "public" and listed.ttl_ms > 0
            toolbox = next((found for tools, found in self._listed if tools == listed.tools), None)
            if toolbox is None:
                toolbox = _toolbox(listed.tools, self.look, checked=not self.trusted)
                self._listed.append((listed.tools, toolbox))
            if self._alike:
                self._kept[scene] = toolbox, asked_at + listed.ttl_ms / 1000
            return toolbox


def _toolbox(tools: Sequence[types.Tool], look: Look | None, *, checked: bool) -> Toolbox:
    described = tuple(ToolDescription(tool.name, tool.description or "", tool.input_schema) for tool in tools)
    return Toolbox(
        described,
        {tool.name: schema_validator(tool.input_schema) for tool in tools},
        {
            tool.name: schema_validator(tool.output_schema)
            for tool in tools
            if checked and tool.output_schema is not None
        },
        look,
    )


def shows_views() -> ClientExtension:
    """Return the extension that a client declares if it shows views, as chat clients do (MCP Apps)."""
    return advertise(APPS, {"mimeTypes": [APP_TYPE]})


def view_in(result: types.CallToolResult) -> dict[str, Any] | None:
    """Return the view attached to a result; None if there is none."""
    found: object = (result.meta or {}).get(VIEW)
    return cast(dict[str, Any], found) if isinstance(found, dict) else None


def joined(before: Mapping[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """Return the later of two views. Its motion starts with that of the earlier view if the two are contiguous."""
    first, second = before.get("motion"), after.get("motion")
    if not first or not second or first["times"][-1] != second["times"][0]:
        return after
    poses: dict[str, Any] = {}
    for name in first["poses"] | second["poses"]:
        # A motion lists only the objects that moved.
        early = first["poses"].get(name) or [second["poses"][name][0]] * len(first["times"])
        late = second["poses"].get(name) or [early[-1]] * len(second["times"])
        poses[name] = [*early, *late[1:]]
    return after | {"motion": {"times": [*first["times"], *second["times"][1:]], "poses": poses}}


async def view_now(client: Client) -> dict[str, Any] | None:
    """Read the current view from the server; None if it publishes none."""
    try:
        (content,) = (await client.read_resource(VIEW_URI)).contents
    except MCPError:
        return None
    return json.loads(content.text) if isinstance(content, types.TextResourceContents) else None
