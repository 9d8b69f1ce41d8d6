"""What was called in an episode and what came of it, kept for the agent itself and for whoever opened the episode.

A client outside the evaluator reports nothing by itself, so that its episode is judged by what the laboratory saw.
Knows MCP results, and neither transports nor physics.
"""

import json
import time
from dataclasses import dataclass, field
from typing import Any

import mcp_types as types
from pydantic_core import to_json

_MAX_NOTED = 20_000
"""Longest arguments that a bounded log keeps [bytes]; longer ones are a mistake or an attack on our memory."""


@dataclass(frozen=True, slots=True)
class LoggedCall:
    """One tool call that reached the laboratory."""

    tool: str
    arguments: dict[str, Any]
    """As they came; NaN and infinities as text, for which JSON has no numbers."""
    result: types.CallToolResult | None
    """None where the client took the call back before it ended."""
    started_s: float
    """Wall time since the episode was opened [s]."""
    duration_s: float

    @property
    def text(self) -> str:
        """What the result says in words: its JSON, or the sentence of a refusal."""
        content = self.result.content if self.result else []
        return "\n".join(one.text for one in content if isinstance(one, types.TextContent))

    def as_json(self) -> dict[str, Any]:
        """The call as the log publishes it."""
        result = self.result
        return {
            "tool": self.tool,
            "arguments": self.arguments,
            "returned": result is not None,
            "is_error": result is not None and bool(result.is_error),
            "content": result and result.structured_content,
            "text": self.text,
            "started_s": round(self.started_s, 6),
            "duration_s": round(self.duration_s, 6),
        }

    def as_note(self) -> dict[str, Any]:
        """The call as a line of the agent's own notes: what it saw, and no wall-clock times."""
        said = {"tool": self.tool, "arguments": self.arguments}
        if self.result is None:
            return said | {"taken_back": True}
        return said | ({"refused": self.text} if self.result.is_error else {"result": self.result.structured_content})


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
        arguments = json.loads(written)
        if self.kept is not None and len(written) > _MAX_NOTED:
            arguments = {"left_out": f"{len(written)} bytes"}
        now = time.monotonic()
        self.calls.append(LoggedCall(params.name, arguments, result, started_at - self.opened_at, now - started_at))
        if self.kept is not None and len(self.calls) > self.kept:
            self.left_out += 1
            del self.calls[0]
