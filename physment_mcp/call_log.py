"""What was called in an episode and what came of it, kept for whoever opened the episode.

A client outside the evaluator reports nothing by itself, so that its episode is judged by what the laboratory saw.
Knows MCP results, and neither transports nor physics.
"""

import json
import time
from dataclasses import dataclass, field
from typing import Any

import mcp_types as types
from pydantic_core import to_json


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

    def as_json(self) -> dict[str, Any]:
        """The call as the log publishes it."""
        result = self.result
        texts = [one.text for one in result.content if isinstance(one, types.TextContent)] if result else []
        return {
            "tool": self.tool,
            "arguments": self.arguments,
            "returned": result is not None,
            "is_error": result is not None and bool(result.is_error),
            "content": result and result.structured_content,
            "text": "\n".join(texts),
            "started_s": round(self.started_s, 6),
            "duration_s": round(self.duration_s, 6),
        }


@dataclass(slots=True)
class CallLog:
    """The calls of one episode, in the order in which they ran."""

    calls: list[LoggedCall] = field(default_factory=list[LoggedCall])
    opened_at: float = field(default_factory=time.monotonic)

    def add(self, params: types.CallToolRequestParams, result: types.CallToolResult | None, started_at: float) -> None:
        """Take down a call.

        Args:
            params: The call.
            result: What the client was given.
            started_at: When it began, by the monotonic clock [s].
        """
        arguments = json.loads(to_json(params.arguments or {}, inf_nan_mode="strings"))
        now = time.monotonic()
        self.calls.append(LoggedCall(params.name, arguments, result, started_at - self.opened_at, now - started_at))
