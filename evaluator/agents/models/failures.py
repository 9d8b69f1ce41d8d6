"""What an error of a provider means: ask again, end the episode, or ask this model no more.

No message contains a key.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import cast

from pydantic_ai import exceptions as ai

from evaluator.errors import AgentError, EvaluatorError, InfrastructureError, PermanentFailure

_DETAIL = 300
"""Most characters of a provider's message that are quoted in ours."""
_POLICY = ("content_filter", "content_policy", "invalid_prompt", "responsibleaipolicy", "safety")
"""Parts of the error codes by which providers refuse a conversation for its content."""
_AGAIN_STATUS = frozenset({408, 409, 425, 429})


class AskAgain(InfrastructureError):
    """The request failed, but the same request may succeed later."""

    def __init__(self, sentence: str, wait_s: float | None = None) -> None:
        super().__init__(sentence)
        self.wait_s = wait_s
        """How long the provider asked us to wait [s], if it did."""


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
"""What the client raises, what it means, and the words for it. The first match counts."""


def judge(error: Exception, key: str | None) -> EvaluatorError:
    """Translate the error of a failed request into one of our errors.

    Args:
        error: What the provider's client raised.
        key: The provider's key, which is removed from the message.

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
    # A server error, an unreadable body, a reply that the client cannot parse: asking again may succeed.
    return AskAgain, f"HTTP {status}" if status else "unusable reply"


def scrubbed(text: str, key: str | None) -> str:
    """A provider's message on one line, without the key, cut to length."""
    if key:
        text = text.replace(key, "[key]")
    return " ".join(text.split())[:_DETAIL]


def _wait(error: Exception) -> float | None:
    """How long the provider asked us to wait [s], if it did."""
    if not isinstance(error, ai.ModelAPIError):
        return None
    headers = (error.headers if isinstance(error, ai.ModelHTTPError) else None) or {}
    until = _date(headers, "retry-after")
    sent = _date(headers, "date")
    if until is not None and sent is not None:
        # Both are of the provider's clock. The client subtracts our own, which may be wrong or jump.
        return max(0.0, (until - sent).total_seconds())
    if error.retry_after is not None:
        return error.retry_after
    # The client reads whole seconds and dates; some providers send fractions of seconds.
    try:
        seconds = float(headers.get("retry-after", ""))
    except ValueError:
        return None
    return seconds if 0 <= seconds < float("inf") else None


def _date(headers: Mapping[str, str], name: str) -> datetime | None:
    """The date in a header; None if it has none."""
    try:
        read = parsedate_to_datetime(headers.get(name, ""))
    except ValueError:
        return None
    return read if read.tzinfo is not None else read.replace(tzinfo=UTC)


def _is_policy(error: ai.ModelAPIError) -> bool:
    code = f"{error.provider_error_code} {error.provider_error_type}".lower()
    return any(part in code for part in _POLICY)


def _detail(error: Exception) -> str:
    """The message in the provider's reply; if there is none, the client's message."""
    body = error.body if isinstance(error, ai.ModelAPIError) else None
    while isinstance(body, Mapping):
        fields = cast(Mapping[str, object], body)
        message = fields.get("message")
        if isinstance(message, str) and message:
            return message
        body = fields.get("error")
    text = body if isinstance(body, str) and body.strip() else str(error)
    return text or type(error).__name__
