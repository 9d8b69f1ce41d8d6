"""A language model as an agent: converts feedback to messages and replies to calls, and keeps the message history."""

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, Self, cast

import httpx2
from pydantic import JsonValue
from pydantic_ai.messages import (
    BinaryContent,
    ModelMessage,
    ModelRequest,
    ModelRequestPart,
    ModelResponse,
    ModelResponsePart,
    TextPart,
    ThinkingPart,
    ToolCallPart,
    ToolReturnPart,
    UserPromptPart,
)

from evaluator.agents.models.choice import Dialect, Lane, ModelChoice, Patience, Provider
from evaluator.agents.models.clients import (
    NOTHING,
    Offer,
    build_model,
    offer,
    open_http,
    request_settings,
    settings_sent,
)
from evaluator.agents.models.requests import MALFORMED_CALL, Requests, raw_finish_reason
from evaluator.episode.player import Briefing, Feedback, Reply, as_text
from evaluator.episode.protocols.text import feedback_text, parse_reply
from evaluator.errors import AgentError
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall, Usage

_NOT_RUN = "Not run."
_NATIVE_IN_TEXT = "it called tools natively, where calls are written as a JSON list"
_CONTEXT_FULL = "model_context_window_exceeded"
"""Anthropic's finish reason for a reply that the context window cut off, as opposed to the output limit."""


@dataclass(slots=True)
class ModelAgent:
    """An agent that plays with a language model. As an async context manager, it closes the model's connections."""

    choice: ModelChoice
    lane: Lane = field(default_factory=Lane)
    patience: Patience = field(default_factory=Patience)
    _requests: Requests | None = field(default=None, repr=False)
    _http: httpx2.AsyncClient | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """The agent's name, as the operator wrote it."""
        return self.choice.name

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ModelPlayer":
        """Start a new conversation, with native tool calls or the text protocol as the episode key says."""
        if self._requests is None:
            self._requests = self._open()
        provider, text = self.choice.provider, key.protocol == "text"
        tools = NOTHING if text else offer(provider.dialect, briefing.tools)
        return _ModelPlayer(self._requests, provider, briefing.prompt, tools, text)

    def facts(self) -> dict[str, JsonValue]:
        """The settings that determine the model's replies, for `run.json`. The API key is not included.

        Raises:
            UsageError: An option is set that would not be sent.
        """
        choice = self.choice
        return {
            "agent": self.name,
            "provider": choice.provider.name,
            "model": choice.model,
            "base_url": choice.shown_url,
            "effort": choice.options.effort,
            "temperature": choice.options.temperature,
            "max_tokens": choice.options.max_tokens,
            "sent": settings_sent(choice),
            "timeout_s": self.patience.timeout_s,
            "attempts": self.patience.attempts,
            "concurrency": self.lane.limit,
        }

    async def __aenter__(self) -> Self:
        """Return self. The first player opens the connections."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the connections."""
        if self._http is not None:
            await self._http.aclose()
        self._http = self._requests = None

    def _open(self) -> Requests:
        self._http = open_http(self.patience.timeout_s)
        model = build_model(self.choice, self._http)
        return Requests(
            model,
            request_settings(model, self.choice, self.patience.timeout_s),
            self.lane,
            self.patience,
            self.name,
            self.choice.key(),
        )


@dataclass(slots=True)
class _ModelPlayer:
    requests: Requests
    provider: Provider
    prompt: str
    offer: Offer
    text: bool
    history: list[ModelMessage] = field(default_factory=list[ModelMessage])

    async def act(self, feedback: Feedback | None) -> Reply:
        self.history.append(ModelRequest(parts=self._shown(feedback)))
        response = await self.requests.ask(self.history, self.offer)
        usage, thought = _usage(response, priced=self.provider.needs_key), _joined(response, ThinkingPart)
        _refuse(response, usage)
        self.history.append(_encodable(response, calls=not self.text))
        problem = _cut_off(response) or _unwritten(response)
        text = _joined(response, TextPart)
        if problem:
            return Reply(_paragraphs(thought, text), malformed=problem, usage=usage, thought_chars=len(thought))
        if self.text:
            reply = parse_reply(text)
            if response.tool_calls:  # beside a JSON list, native calls would be a second set of calls
                said = _paragraphs(thought, text)
                return Reply(said, malformed=_NATIVE_IN_TEXT, usage=usage, thought_chars=len(thought))
            said = _paragraphs(thought, reply.reasoning)
            return Reply(said, reply.calls, reply.malformed, usage, thought_chars=len(thought))
        calls, problem = _calls(response)
        return Reply(_paragraphs(thought, text), calls, problem, usage, thought_chars=len(thought))

    def _shown(self, feedback: Feedback | None) -> list[ModelRequestPart]:
        """Build the next message: the prompt, or the results of the last calls."""
        if feedback is None:
            return [UserPromptPart(self.prompt)]
        if self.text:
            return [_with_frames(feedback_text(feedback), feedback.exchanges)]
        asked = self.history[-1]
        calls = asked.tool_calls if isinstance(asked, ModelResponse) else []
        returns = [self._return(call, index, feedback) for index, call in enumerate(calls)]
        # Each tool result is a message part of its own. The note uses the wording of the text protocol.
        rest = feedback_text(Feedback((), feedback.note, feedback.remaining))
        return [*returns, _with_frames(rest, feedback.exchanges)]

    def _return(self, call: ToolCallPart, index: int, feedback: Feedback) -> ToolReturnPart:
        """Build the result part of one call. Providers require a result for every call, even if it was not run."""
        exchange = feedback.exchanges[index] if index < len(feedback.exchanges) else None
        content, failed = _content(exchange)
        # The chat-completions client would change the text of an error, so that the record would differ from what the
        # model read. Only the other two dialects mark errors.
        marked = failed and self.provider.dialect in {Dialect.ANTHROPIC, Dialect.GOOGLE}
        return ToolReturnPart(call.tool_name, content, call.tool_call_id, outcome="failed" if marked else "success")


def _with_frames(text: str, exchanges: Sequence[Exchange]) -> UserPromptPart:
    """Append the camera frames of results to a text message, each labelled with the number of its call.

    Not every provider accepts images inside a tool result.
    """
    parts: list[str | BinaryContent] = [text]
    for number, exchange in enumerate(exchanges, start=1):
        for frame in exchange.frames:
            parts += [
                f"Picture after call {number}, {exchange.call.tool}:",
                BinaryContent(frame.png, media_type="image/png"),
            ]
    return UserPromptPart(parts if len(parts) > 1 else text)


def _content(exchange: Exchange | None) -> tuple[str, bool]:
    """Return the text of a tool result, and whether it is an error."""
    if exchange is None:
        return _NOT_RUN, True
    if exchange.returned:
        return exchange.text, exchange.is_error
    return (f"{_NOT_RUN} {exchange.text}".strip(), True)


def _calls(response: ModelResponse) -> tuple[tuple[ToolCall, ...], str]:
    """Return the calls of a reply in order, or no calls and the reason why one of them cannot be read."""
    calls: list[ToolCall] = []
    for part in response.tool_calls:
        try:
            calls.append(ToolCall(tool=part.tool_name, arguments=_arguments(part)))
        except (ValueError, RecursionError) as error:
            return (), f"the arguments of {part.tool_name} are not a JSON object: {error}"
    return tuple(calls), ""


def _arguments(part: ToolCallPart) -> dict[str, Any]:
    """Return the arguments of a call; they are parsed if the model wrote them as JSON text."""
    if isinstance(part.args, dict):
        return part.args
    arguments: Any = json.loads(part.args) if part.args else {}
    if not isinstance(arguments, dict):
        raise ValueError(f"they are a {type(arguments).__name__}")  # noqa: TRY004 - caught above, as bad JSON
    return cast(dict[str, Any], arguments)


def _refuse(response: ModelResponse, usage: Usage) -> None:
    """Raise if the model refuses or cannot continue."""
    details = response.provider_details or {}
    if response.finish_reason == "content_filter":
        reason = details.get("refusal") or details.get("block_reason") or raw_finish_reason(response)
        words = _joined(response, TextPart)
        raise AgentError(
            f"the model or its content filter refused ({reason or 'no reason given'}){words and ': ' + words}", usage
        )
    if raw_finish_reason(response) == _CONTEXT_FULL:
        raise AgentError("the conversation no longer fits the model's context window", usage)


def _encodable(response: ModelResponse, *, calls: bool) -> ModelResponse:
    """Return the reply in a form that can be sent back to the provider.

    Models write lone surrogates, which UTF-8 cannot encode. Anthropic rejects text that is only whitespace. In the text
    protocol, native calls are dropped because they would have no result.
    """
    parts = [
        _sendable(part)
        for part in response.parts
        if (calls or not isinstance(part, ToolCallPart)) and (not isinstance(part, TextPart) or part.content.strip())
    ]
    return replace(response, parts=parts)


def _sendable(part: ModelResponsePart) -> ModelResponsePart:
    match part:
        case TextPart() | ThinkingPart():
            return replace(part, content=as_text(part.content))
        case ToolCallPart(args=str(args)):
            return replace(part, args=as_text(args))
        case _:
            return part


def _cut_off(response: ModelResponse) -> str:
    if response.finish_reason != "length":
        return ""
    return "it was cut off at the limit of output tokens"


def _unwritten(response: ModelResponse) -> str:
    return "the tool call was not well-formed" if raw_finish_reason(response) in MALFORMED_CALL else ""


def _joined(response: ModelResponse, kind: type[TextPart] | type[ThinkingPart]) -> str:
    return "\n\n".join(part.content for part in response.parts if isinstance(part, kind) and part.content.strip())


def _paragraphs(*texts: str) -> str:
    return "\n\n".join(text for text in texts if text)


def _usage(response: ModelResponse, *, priced: bool) -> Usage:
    used = response.usage
    return Usage(
        input_tokens=used.input_tokens,
        output_tokens=used.output_tokens,
        cached_tokens=used.cache_read_tokens,
        cost_usd=_cost(response, priced=priced),
    )


def _cost(response: ModelResponse, *, priced: bool) -> float | None:
    """Cost of a reply [USD]: as billed by the provider, otherwise from the price table; None if neither is known.

    Args:
        response: The reply.
        priced: Whether the price table applies to this provider. The table identifies models by name alone, so it
            would also match models on local servers.
    """
    billed = (response.provider_details or {}).get("cost")
    if isinstance(billed, int | float):
        return float(billed)
    if not priced:
        return None
    with contextlib.suppress(LookupError, ValueError, AssertionError):
        return float(response.cost().total_price)
    return None
