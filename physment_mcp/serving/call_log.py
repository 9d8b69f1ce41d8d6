"""The calls of an episode and their results, kept for the agent itself and for the program that opened the episode.

A client that is not the evaluator's reports nothing, so its episode is judged by this log. Knows MCP results. Knows no
transports and no physics.
"""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import mcp_types as types
from pydantic_core import to_json

from physment_mcp.tools.calls import MAX_NAME, excess
from physment_mcp.tools.episode import ANSWER

MAX_EPISODE_BYTES = 4_000_000
"""Most arguments that an episode may bring in all its calls [bytes of JSON]; 10,000 usual calls bring half of it."""
MAX_PAGE_BYTES = 30_000
"""Most arguments and results in one reply about the log [bytes], so that writing it takes 1 ms."""
FULL = f"the calls of this episode have brought {MAX_EPISODE_BYTES} bytes, which is the limit; you can only answer now"
_TRUTH = {True: "true", False: "false"}


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
    def size(self) -> int:
        """Bytes of arguments and result, roughly."""
        return len(self.written) + len(self.text or "")

    @property
    def result(self) -> str | None:
        """The structured result in JSON; None if the call was refused or cancelled."""
        return None if self.is_error else self.text

    def as_json(self) -> str:
        """The call as the owner of the episode reads it, in JSON, of which arguments and result are parts already."""
        return (
            f'{{"tool":{json.dumps(self.tool)},"arguments":{self.written.decode()},'
            f'"returned":{_TRUTH[self.text is not None]},"is_error":{_TRUTH[self.is_error]},'
            f'"content":{self.result or "null"},"text":{json.dumps(self.text or "")},'
            f'"started_s":{self.started_s:.6f},"duration_s":{self.duration_s:.6f}}}'
        )

    def as_note(self, number: int) -> str:
        """The call as the agent reads it, in JSON: what it saw, without wall-clock times.

        Args:
            number: Which call of the episode it is, counted from 1.
        """
        if self.text is None:
            seen = '"taken_back":true'
        else:
            seen = f'"refused":{json.dumps(self.text)}' if self.is_error else f'"result":{self.text}'
        return f'{{"call":{number},"tool":{json.dumps(self.tool)},"arguments":{self.written.decode()},{seen}}}'


@dataclass(slots=True)
class CallLog:
    """The calls of one episode, in the order in which they ran."""

    kept: int | None = None
    """How many of the latest calls to keep; None for all."""
    calls: list[LoggedCall] = field(default_factory=list[LoggedCall])
    left_out: int = 0
    """Calls that are no longer kept."""
    size: int = 0
    """Bytes of all arguments noted so far."""
    opened_at: float = field(default_factory=time.monotonic)

    @property
    def full(self) -> bool:
        """Whether the episode has brought as much as it may; then only its answer is taken."""
        return self.size > MAX_EPISODE_BYTES

    def page_from(self, first: int) -> Sequence[LoggedCall]:
        """The calls from an index in `calls` on, as many as fill a page; at least one if there is one.

        Args:
            first: Counted from 0.
        """
        size, end = 0, first
        while end < len(self.calls) and (size := size + self.calls[end].size) <= MAX_PAGE_BYTES:
            end += 1
        return self.calls[first : max(end, first + 1)]

    def newest_page(self) -> Sequence[LoggedCall]:
        """The newest calls, as many as fill a page."""
        size, first = 0, len(self.calls)
        while first > 0 and (size := size + self.calls[first - 1].size) <= MAX_PAGE_BYTES:
            first -= 1
        return self.calls[first:]

    def add(self, params: types.CallToolRequestParams, result: types.CallToolResult | None, started_at: float) -> None:
        """Record a call.

        Args:
            params: The call.
            result: What the client received; None if it cancelled the call.
            started_at: When the call began, by the monotonic clock [s].
        """
        arguments = params.arguments or {}
        # What was refused as too large is a mistake, or an attempt to fill the memory.
        too_large = excess(params.name, arguments)
        is_error = result is not None and bool(result.is_error)
        if too_large or (self.full and (is_error or params.name != ANSWER.name)):
            arguments = {"left_out": too_large or FULL}
        written = to_json(arguments, inf_nan_mode="strings")
        # Only the text is kept: keeping the result objects made every later call a tenth slower, because the garbage
        # collector looks at them again and again.
        texts = (part.text for part in result.content if isinstance(part, types.TextContent)) if result else ()
        text = next(iter(texts), "") if result else None
        took = time.monotonic() - started_at
        self.size += len(written)
        self.calls.append(
            LoggedCall(params.name[:MAX_NAME], written, text, is_error, started_at - self.opened_at, took)
        )
        if self.kept is not None and len(self.calls) > self.kept:
            self.left_out += 1
            del self.calls[0]
