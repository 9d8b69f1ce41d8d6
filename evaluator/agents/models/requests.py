"""Sends requests to a model with rate limits, time-outs and backoff, and classifies the provider's errors.

Only this module retries requests. No error message contains the API key.
"""

import random
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import cast

import anyio
from pydantic_ai import InstrumentationSettings, ModelHTTPError, ModelMessage, ModelResponse, ModelSettings
from pydantic_ai import exceptions as ai
from pydantic_ai.direct import model_request
from pydantic_ai.models import Model
from pydantic_ai.settings import merge_model_settings

from evaluator.agents.models.choice import Lane, Patience
from evaluator.agents.models.clients import NOTHING, Offer
from evaluator.episode.tracing import are_recorded
from evaluator.errors import AgentError, EvaluatorError, InfrastructureError, PermanentFailure

_DETAIL = 300
"""Largest number of characters quoted from a provider's message."""
_POLICY = ("content_filter", "content_policy", "invalid_prompt", "responsibleaipolicy", "safety")
"""Parts of the error codes with which providers reject a conversation for its content."""
_AGAIN_STATUS = frozenset({408, 409, 425, 429})


class AskAgain(InfrastructureError):
    """A transient failure: the same request may succeed later."""

    def __init__(self, sentence: str, wait_s: float | None = None) -> None:
        super().__init__(sentence)
        self.wait_s = wait_s
        """Pause that the provider requested [s]; None if it requested none."""


_RULES: tuple[tuple[type[Exception], type[EvaluatorError], str], ...] = (
    (ai.ModelContextWindowExceededError, AgentError, "the conversation no longer fits the model's context window"),
    (ai.ContentFilterError, AgentError, "the provider's content filter refused"),
    (ai.ModelAuthenticationError, PermanentFailure, "the provider refused the key"),
    (ai.ModelNotFoundError, PermanentFailure, "the provider has no such model, or nothing at this address"),
    (ai.ModelQuotaExceededError, PermanentFailure, "quota or credit is used up"),
    (ai.ModelRateLimitError, AskAgain, "rate limit"),
    (ai.ModelRequestTimeout, AskAgain, "no reply in time"),
    (ai.ModelTimeoutError, AskAgain, "no reply in time"),
    (ai.ModelConnectionError, AskAgain, "connection failed"),
    (ai.ModelRequestRejectedError, PermanentFailure, "the provider rejected the request"),
    (ai.UserError, PermanentFailure, "the request cannot be made"),
)
"""Exception of the client library → exception and wording of this package. The first match applies."""


def judge(error: Exception, key: str | None) -> EvaluatorError:
    """Translate the error of a failed request into an error of this package.

    Args:
        error: Exception of the provider's client.
        key: The API key, which is removed from the message.

    Returns:
        `AskAgain`, `PermanentFailure`, or `AgentError` if the model itself cannot continue.
    """
    kind, meaning = _meaning(error)
    sentence = f"{meaning}: {scrubbed(_detail(error), key)}"
    return AskAgain(sentence, _wait(error)) if kind is AskAgain else kind(sentence)


def _meaning(error: Exception) -> tuple[type[EvaluatorError], str]:
    status = error.status_code if isinstance(error, ai.ModelHTTPError) else 0
    if isinstance(error, ai.ModelAPIError) and _is_policy(error):
        return AgentError, "the provider refused the conversation for its content"
    if status == 413:
        return AgentError, "the conversation is too large for the provider"
    for raised, kind, meaning in _RULES:
        if isinstance(error, raised):
            return kind, meaning
    if 400 <= status < 500 and status not in _AGAIN_STATUS:
        return PermanentFailure, f"the provider rejected the request (HTTP {status})"
    # A server error, an unreadable body or a reply that the client cannot parse: a retry may succeed.
    return AskAgain, f"HTTP {status}" if status else "unusable reply"


def scrubbed(text: str, key: str | None) -> str:
    """Return a provider's message on one line, without the API key, truncated."""
    if key:
        text = text.replace(key, "[key]")
    return " ".join(text.split())[:_DETAIL]


def _wait(error: Exception) -> float | None:
    """Return the pause that the provider requested [s]; None if it requested none."""
    if not isinstance(error, ai.ModelAPIError):
        return None
    headers = (error.headers if isinstance(error, ai.ModelHTTPError) else None) or {}
    until = _date(headers, "retry-after")
    sent = _date(headers, "date")
    if until is not None and sent is not None:
        # Both dates come from the provider's clock. The client would subtract our clock, which may be wrong.
        return max(0.0, (until - sent).total_seconds())
    if error.retry_after is not None:
        return error.retry_after
    # The client parses whole seconds and dates; some providers send fractional seconds.
    try:
        seconds = float(headers.get("retry-after", ""))
    except ValueError:
        return None
    return seconds if 0 <= seconds < float("inf") else None


def _date(headers: Mapping[str, str], name: str) -> datetime | None:
    """Parse the date in a header; None if the header holds none."""
    try:
        read = parsedate_to_datetime(headers.get(name, ""))
    except ValueError:
        return None
    return read if read.tzinfo is not None else read.replace(tzinfo=UTC)


def _is_policy(error: ai.ModelAPIError) -> bool:
    code = f"{error.provider_error_code} {error.provider_error_type}".lower()
    return any(part in code for part in _POLICY)


def _detail(error: Exception) -> str:
    """Return the message in the provider's reply; if there is none, the client's message."""
    body = error.body if isinstance(error, ai.ModelAPIError) else None
    while isinstance(body, Mapping):
        fields = cast(Mapping[str, object], body)
        message = fields.get("message")
        if isinstance(message, str) and message:
            return message
        body = fields.get("error")
    text = body if isinstance(body, str) and body.strip() else str(error)
    return text or type(error).__name__


MALFORMED_CALL = frozenset({"MALFORMED_FUNCTION_CALL", "UNEXPECTED_TOOL_CALL"})
"""Gemini's finish reasons for a malformed call, which the model caused and not the service."""


_SPANS = InstrumentationSettings(include_content=False, include_model_request_parameters=False)
"""Tracing without message content, which may hold secrets that the records have removed."""


@dataclass(slots=True)
class Requests:
    """Sends the requests of one model at one provider."""

    model: Model
    settings: ModelSettings
    lane: Lane
    patience: Patience
    label: str
    """Name of the model in error messages."""
    key: str | None = field(default=None, repr=False)
    """API key, which is removed from error messages."""
    sleep: Callable[[float], Awaitable[None]] = anyio.sleep
    clock: Callable[[], float] = time.monotonic
    luck: Callable[[], float] = random.random
    """Random numbers from 0 to 1 for jitter, which spreads the retries of requests that failed together."""
    retries: int = 0
    """Number of retries so far."""

    async def ask(self, messages: Sequence[ModelMessage], tools: Offer = NOTHING) -> ModelResponse:
        """Send the conversation, and retry until there is a reply.

        Args:
            messages: The conversation so far.
            tools: Tools that the model may call.

        Raises:
            AgentError: The model refuses, or the conversation is too long for it.
            InfrastructureError: There was no reply within `patience`, or a retry cannot help.
        """
        waited_s = 0.0
        for attempt in range(1, self.patience.attempts + 1):
            try:
                async with self.lane.limiter:
                    # Check here: the provider may have requested a pause while this request waited in the queue.
                    waited_s += await self._wait_for_lane(self.patience.total_wait_s - waited_s)
                    return await self._attempt(messages, tools)
            except AskAgain as failure:
                pause_s = self._pause(attempt, failure.wait_s)
                if attempt == self.patience.attempts or waited_s + pause_s > self.patience.total_wait_s:
                    asked = "" if failure.wait_s is None else f", which asked for a pause of {failure.wait_s:.0f} s"
                    raise InfrastructureError(
                        f"{self.label} gave no reply in {attempt} attempts{asked}: {failure}"
                    ) from failure
                if failure.wait_s is not None:
                    self.lane.shut_until = max(self.lane.shut_until, self.clock() + failure.wait_s)
            self.retries += 1
            waited_s += pause_s
            await self.sleep(pause_s)
        raise AssertionError("the last attempt returns or raises")

    async def _attempt(self, messages: Sequence[ModelMessage], tools: Offer) -> ModelResponse:
        try:
            response = await model_request(
                self.model,
                messages,
                model_settings=merge_model_settings(self.settings, tools.settings),
                model_request_parameters=tools.parameters,
                instrument=_SPANS if are_recorded() else None,
            )
        except Exception as error:  # noqa: BLE001 - whatever a client raises, the turn failed; `judge` says how
            # Do not chain the error: the client's exception holds the request, and with it the API key.
            failure = judge(error, self.key)
            if isinstance(failure, PermanentFailure) and len(messages) > 1 and _is_rejected(error):
                # Earlier requests were accepted, so the provider rejects this conversation, not every request.
                raise AgentError(str(failure)) from None
            raise failure from None
        reason = raw_finish_reason(response)
        if response.finish_reason == "error" and reason not in MALFORMED_CALL:
            raise AskAgain(f"the provider broke off its reply ({reason or 'no reason given'})")
        return response

    async def _wait_for_lane(self, patience_s: float) -> float:
        """Wait until the pause that the provider requested is over; return the time waited [s]."""
        wait_s = self.lane.shut_until - self.clock()
        if wait_s <= 0:
            return 0.0
        if wait_s > patience_s:
            raise InfrastructureError(f"{self.label} asked for a pause of {wait_s:.0f} s more")
        wait_s += self.luck() * min(wait_s, self.patience.first_pause_s)
        await self.sleep(wait_s)
        return wait_s

    def _pause(self, attempt: int, asked_s: float | None) -> float:
        """Pause before the next attempt [s]: exponential with jitter, and at least what the provider requested."""
        ceiling = min(self.patience.longest_pause_s, self.patience.first_pause_s * 2 ** (attempt - 1))
        jittered = ceiling * (0.5 + self.luck() / 2)
        return jittered if asked_s is None else max(asked_s, 0.0) + jittered / 10


def _is_rejected(error: Exception) -> bool:
    """Whether a provider rejected a request as malformed. Earlier replies of the model can cause this."""
    return isinstance(error, ModelHTTPError) and error.status_code in {400, 422}


def raw_finish_reason(response: ModelResponse) -> str:
    """Return the provider's own finish reason; empty if it gave none."""
    return str((response.provider_details or {}).get("finish_reason") or "")
