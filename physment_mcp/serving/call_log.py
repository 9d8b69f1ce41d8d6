"""What was called in an episode and what came of it, kept for the agent itself and for whoever opened the episode.

A client outside the evaluator reports nothing by itself, so that its episode is judged by what the laboratory saw.
Knows MCP results, and neither transports nor physics.
"""

import json
import time
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mcp_types as types
from pydantic_core import to_json

_MAX_NOTED = 20_000
"""Longest arguments that a bounded log keeps [bytes]; longer ones are a mistake or an attack on our memory."""


class LoggedCall(NamedTuple):
    """One tool call that reached the laboratory."""

    tool: str
    written: bytes
    """The arguments as they came, in JSON; NaN and infinities as text, for which it has no numbers."""
    text: str | None
    """What the client was given: a result in JSON, or the sentence of a refusal; None if it took the call back."""
    is_error: bool
    started_s: float
    """Wall time since the episode was opened [s]."""
    duration_s: float

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments; read again each time, for most are never asked for."""
        return json.loads(self.written)

    @property
    def content(self) -> dict[str, Any] | None:
        """The structured result; None if there is none."""
        return None if self.text is None or self.is_error else json.loads(self.text)

    def as_json(self) -> dict[str, Any]:
        """The call as the log publishes it."""
        return {
            "tool": self.tool,
            "arguments": self.arguments,
            "returned": self.text is not None,
            "is_error": self.is_error,
            "content": self.content,
            "text": self.text or "",
            "started_s": round(self.started_s, 6),
            "duration_s": round(self.duration_s, 6),
        }

    def as_note(self) -> dict[str, Any]:
        """The call as a line of the agent's own notes: what it saw, and no wall-clock times."""
        said = {"tool": self.tool, "arguments": self.arguments}
        if self.text is None:
            return said | {"taken_back": True}
        return said | ({"refused": self.text} if self.is_error else {"result": self.content})


@dataclass(slots=True)
class CallLog:
    """The calls of one episode, in the order in which they ran."""

    kept: int | None = None
    """Most calls that are kept, the latest ones; None for all."""
    calls: list[LoggedCall] = field(default_factory=list[LoggedCall])
    left_out: int = 0
    """Calls that were forgotten because there were more than are kept."""
    opened_at: float = field(default_factory=time.monotonic)

    def add(self, params: types.CallToolRequestParams, result: types.CallToolResult | None, started_at: float) -> None:
        """Take down a call.

        Args:
            params: The call.
            result: What the client was given.
            started_at: When it began, by the monotonic clock [s].
        """
        written = to_json(params.arguments or {}, inf_nan_mode="strings")
        if self.kept is not None and len(written) > _MAX_NOTED:
            written = to_json({"left_out": f"{len(written)} bytes"})
        # Texts alone: to hold on to the results themselves made every later call slower by a tenth, through the
        # collector of garbage, which goes through them again and again.
        said = (one.text for one in result.content if isinstance(one, types.TextContent)) if result else ()
        text = next(iter(said), "") if result else None
        is_error = result is not None and bool(result.is_error)
        took = time.monotonic() - started_at
        self.calls.append(LoggedCall(params.name, written, text, is_error, started_at - self.opened_at, took))
        if self.kept is not None and len(self.calls) > self.kept:
            self.left_out += 1
            del self.calls[0]
