"""The calls of an episode and their results, kept for the agent itself and for the program that opened the episode.

A client that is not the evaluator's reports nothing, so its episode is judged by this log. Knows MCP results. Knows no
transports and no physics.
"""

import json
import time
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mcp_types as types
from pydantic_core import to_json

_MAX_NOTED = 20_000
"""Longest arguments that a bounded log keeps [bytes]; longer ones are a mistake, or an attempt to fill the memory."""


class LoggedCall(NamedTuple):
    """One tool call that reached the laboratory."""

    tool: str
    written: bytes
    """The arguments as they came, in JSON; NaN and infinities as text, because JSON has no numbers for them."""
    text: str | None
    """What the client received: a result in JSON, or the sentence of a refusal; None if it cancelled the call."""
    is_error: bool
    started_s: float
    """Wall time since the episode was opened [s]."""
    duration_s: float

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments, read from JSON at each use: most are never used."""
        return json.loads(self.written)

    @property
    def content(self) -> dict[str, Any] | None:
        """The structured result; None if the call was refused or cancelled."""
        return None if self.text is None or self.is_error else json.loads(self.text)

    def as_json(self) -> dict[str, Any]:
        """The call as the owner of the episode reads it."""
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
        """The call as the agent reads it: what it saw, without wall-clock times."""
        said = {"tool": self.tool, "arguments": self.arguments}
        if self.text is None:
            return said | {"taken_back": True}
        return said | ({"refused": self.text} if self.is_error else {"result": self.content})


@dataclass(slots=True)
class CallLog:
    """The calls of one episode, in the order in which they ran."""

    kept: int | None = None
    """How many of the latest calls to keep; None for all."""
    calls: list[LoggedCall] = field(default_factory=list[LoggedCall])
    left_out: int = 0
    """Calls that are no longer kept."""
    opened_at: float = field(default_factory=time.monotonic)

    def add(self, params: types.CallToolRequestParams, result: types.CallToolResult | None, started_at: float) -> None:
        """Record a call.

        Args:
            params: The call.
            result: What the client received; None if it cancelled the call.
            started_at: When the call began, by the monotonic clock [s].
        """
        written = to_json(params.arguments or {}, inf_nan_mode="strings")
        if self.kept is not None and len(written) > _MAX_NOTED:
            written = to_json({"left_out": f"{len(written)} bytes"})
        # Only the text is kept: keeping the result objects made every later call a tenth slower, because the garbage
        # collector looks at them again and again.
        texts = (part.text for part in result.content if isinstance(part, types.TextContent)) if result else ()
        text = next(iter(texts), "") if result else None
        is_error = result is not None and bool(result.is_error)
        took = time.monotonic() - started_at
        self.calls.append(LoggedCall(params.name, written, text, is_error, started_at - self.opened_at, took))
        if self.kept is not None and len(self.calls) > self.kept:
            self.left_out += 1
            del self.calls[0]
