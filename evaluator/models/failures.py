"""What an error of a provider means: ask again, give the episode up, or give asking up.

Keys never get into a sentence.
"""

from collections.abc import Mapping
from typing import cast

from pydantic_ai import exceptions as ai

from evaluator.errors import AgentError, EvaluatorError, InfrastructureError, PermanentFailure

_DETAIL = 300
"""Most characters of a provider's own words in a sentence of ours."""
_POLICY = ("content_filter", "content_policy", "invalid_prompt", "responsibleaipolicy", "safety")
"""Parts of error codes by which providers refuse a conversation for what it says."""
_AGAIN_STATUS = frozenset({408, 409, 425, 429})


class AskAgain(InfrastructureError):
    """The request failed in a way that may pass."""

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
"""What the client raises → what it amounts to, and how that is said; the first that fits counts."""


def judge(error: Exception, key: str | None) -> EvaluatorError:
    """The error of ours that a failed request amounts to.

    Args:
        error: What the provider's client raised.
        key: The provider's key, to be struck out of its words.

    Returns:
        `AskAgain`, `PermanentFailure`, or `AgentError` where the model itself cannot go on.
    """
    kind, said = _meaning(error)
    sentence = f"{said}: {scrubbed(_detail(error), key)}"
    return AskAgain(sentence, _wait(error)) if kind is AskAgain else kind(sentence)


def _meaning(error: Exception) -> tuple[type[EvaluatorError], str]:
    status = error.status_code if isinstance(error, ai.ModelHTTPError) else 0
    if isinstance(error, ai.ModelAPIError) and _is_policy(error):
        return AgentError, "the provider refused the conversation for its content"
    if status == 413:
        return AgentError, "the conversation is too large for the provider"
    for kind, meaning, said in _RULES:
        if isinstance(error, kind):
            return meaning, said
    if 400 <= status < 500 and status not in _AGAIN_STATUS:
        return PermanentFailure, f"the provider rejected the request (HTTP {status})"
    # A server error, an unreadable body, a reply that the client cannot digest: all of these may pass.
    return AskAgain, f"HTTP {status}" if status else "unusable reply"


def scrubbed(text: str, key: str | None) -> str:
    """A provider's words on one line, cut to length, without the key."""
    if key:
        text = text.replace(key, "[key]")
    return " ".join(text.split())[:_DETAIL]


def _wait(error: Exception) -> float | None:
    """Seconds that the provider asked us to wait, if it did."""
    if not isinstance(error, ai.ModelAPIError):
        return None
    if error.retry_after is not None:
        return error.retry_after
    # The client reads whole seconds and dates; some providers send fractions.
    headers = error.headers if isinstance(error, ai.ModelHTTPError) else None
    try:
        seconds = float((headers or {}).get("retry-after", ""))
    except ValueError:
        return None
    return seconds if 0 <= seconds < float("inf") else None


def _is_policy(error: ai.ModelAPIError) -> bool:
    said = f"{error.provider_error_code} {error.provider_error_type}".lower()
    return any(part in said for part in _POLICY)


def _detail(error: Exception) -> str:
    """The provider's own sentence where its reply has one, else the client's."""
    body = error.body if isinstance(error, ai.ModelAPIError) else None
    while isinstance(body, Mapping):
        fields = cast(Mapping[str, object], body)
        message = fields.get("message")
        if isinstance(message, str) and message:
            return message
        body = fields.get("error")
    text = body if isinstance(body, str) and body.strip() else str(error)
    return text or type(error).__name__
