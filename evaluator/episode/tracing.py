"""Data about running episodes for observers: OpenTelemetry spans, and the current turn and call for displays.

Spans of episodes, turns and calls are recorded only if an exporter is configured. Their attribute names follow the
semantic conventions for GenAI and MCP; other names begin with `physment.`. Spans hold names, numbers and error types.
They never hold a prompt, an argument, a result, an answer or an error message, because an error message could quote one
of these.
"""

import contextlib
import time
from collections.abc import Generator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field

from opentelemetry.trace import Span, SpanKind, StatusCode, get_current_span, get_tracer

from evaluator.records.episode import Episode, EpisodeKey, Exchange, Outcome

_TRACER = get_tracer("physment-eval")


@contextlib.contextmanager
def _span(name: str, attributes: Mapping[str, str | int]) -> Generator[Span]:
    """Start a span that records the type of an exception but not its message."""
    with _TRACER.start_as_current_span(
        name,
        kind=SpanKind.INTERNAL,
        attributes=attributes,
        record_exception=False,
        set_status_on_exception=False,
    ) as span:
        try:
            yield span
        except Exception as error:
            _fail(span, type(error).__name__)
            raise


def episode_span(key: EpisodeKey) -> contextlib.AbstractContextManager[Span]:
    """Start the span of an episode with all its attempts, as an `invoke_agent` operation."""
    attributes = {f"physment.{name}": value for name, value in key.model_dump().items() if name != "agent"}
    agent = {"gen_ai.operation.name": "invoke_agent", "gen_ai.agent.name": key.agent}
    return _span(f"invoke_agent {key.agent}", attributes | agent)


def end_episode(span: Span, episode: Episode) -> None:
    """Record how an episode ended."""
    span.set_attributes(
        {
            "physment.outcome": episode.outcome.value,
            "physment.turns": len(episode.turns),
            "physment.attempts": episode.attempts,
        }
    )
    if episode.usage is not None:
        span.set_attribute("gen_ai.usage.input_tokens", episode.usage.input_tokens)
        span.set_attribute("gen_ai.usage.output_tokens", episode.usage.output_tokens)
    if episode.outcome in {Outcome.AGENT_ERROR, Outcome.INFRASTRUCTURE_ERROR}:
        _fail(span, episode.outcome.value)


def turn_span(number: int) -> contextlib.AbstractContextManager[Span]:
    """Start the span of a turn.

    Args:
        number: Number of the turn, from 1.
    """
    return _span("turn", {"physment.turn": number})


def call_span(tool: str) -> contextlib.AbstractContextManager[Span]:
    """Start the span of a tool call. The MCP library adds another span for the request."""
    attributes = {"gen_ai.operation.name": "execute_tool", "gen_ai.tool.name": tool, "mcp.method.name": "tools/call"}
    return _span(f"execute_tool {tool}", attributes)


def end_call(span: Span, exchange: Exchange) -> None:
    """Mark the span of a refused call as failed."""
    if exchange.is_error:
        _fail(span, "tool_error")


def are_recorded() -> bool:
    """Whether the current span is recorded; if not, further spans are not worth creating."""
    return get_current_span().is_recording()


def _fail(span: Span, kind: str) -> None:
    span.set_attribute("error.type", kind)
    span.set_status(StatusCode.ERROR)


@dataclass(slots=True)
class Underway:
    """State of a running episode for displays. It changes during play and is not recorded."""

    key: EpisodeKey
    turn: int = 0
    """Number of the present turn, from 1; 0 before the first one, and if another process plays the episode."""
    call: str = ""
    """Name of the last tool that was called; empty before the first call."""
    began_at: float = field(default_factory=time.monotonic)
    """Time of its beginning on the monotonic clock [s]."""


UNDERWAY: ContextVar[Underway | None] = ContextVar("UNDERWAY", default=None)
"""The episode that the present task plays; None if no display needs it."""


def note_turn(number: int) -> None:
    """Record that a turn begins.

    Args:
        number: Number of the turn, from 1.
    """
    present = UNDERWAY.get()
    if present is not None:
        present.turn = number


def note_call(tool: str) -> None:
    """Record that a tool is called."""
    present = UNDERWAY.get()
    if present is not None:
        present.call = tool
