"""Spans of OpenTelemetry: what an evaluation does and how long it takes. They record nothing unless spans are exported.

Attribute names are those of the semantic conventions for GenAI and MCP; ours begin with `physment.`. Spans hold names,
numbers and types of errors: no prompt, argument, return, answer or text of an error, which could quote one of them.
"""

import contextlib
from collections.abc import Generator, Mapping

from opentelemetry.trace import Span, SpanKind, StatusCode, get_current_span, get_tracer

from evaluator.records.episode import Episode, EpisodeKey, Exchange, Outcome

_TRACER = get_tracer("physment-eval")


@contextlib.contextmanager
def _span(name: str, attributes: Mapping[str, str | int]) -> Generator[Span]:
    """A span that tells the type of an error and not its text."""
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
    """The span of an episode with all its attempts: an agent is invoked."""
    attributes = {f"physment.{name}": value for name, value in key.model_dump().items() if name != "agent"}
    agent = {"gen_ai.operation.name": "invoke_agent", "gen_ai.agent.name": key.agent}
    return _span(f"invoke_agent {key.agent}", attributes | agent)


def end_episode(span: Span, episode: Episode) -> None:
    """Note how an episode ended."""
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
    """The span of a turn.

    Args:
        number: From 1.
    """
    return _span("turn", {"physment.turn": number})


def call_span(tool: str) -> contextlib.AbstractContextManager[Span]:
    """The span of a tool call. The MCP library adds one of its own for the request."""
    attributes = {"gen_ai.operation.name": "execute_tool", "gen_ai.tool.name": tool, "mcp.method.name": "tools/call"}
    return _span(f"execute_tool {tool}", attributes)


def end_call(span: Span, exchange: Exchange) -> None:
    """Note that a call was refused, if it was."""
    if exchange.is_error:
        _fail(span, "tool_error")


def are_recorded() -> bool:
    """Whether the current span is recorded, so that it is worth making more of them."""
    return get_current_span().is_recording()


def _fail(span: Span, kind: str) -> None:
    span.set_attribute("error.type", kind)
    span.set_status(StatusCode.ERROR)
