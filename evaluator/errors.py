"""The errors of the evaluator and their consequences.

EvaluatorError
├─ UsageError             the operator asked for something impossible    → one sentence, exit code 2
├─ StoreError             a run folder cannot be read or written         → one sentence, exit code 2
├─ AgentError             the agent cannot continue                      → recorded as the episode's outcome
├─ RefusedRequest         the referee refuses a request                  → an HTTP response with its status
└─ InfrastructureError    server or connection failed                    → the episode is retried, never scored wrong
   ├─ ServerFull          server is at its limit of open episodes        → a referee answers 429
   └─ PermanentFailure    a retry cannot help                            → the agent's other episodes are not played
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # importing pydantic takes 0.2 s, which `--help` avoids
    from evaluator.records.episode import Usage


def reason_of(error: OSError | ValueError) -> str:
    """Return why a file cannot be read: the system's message, or the first validation error of a record."""
    if isinstance(error, OSError):
        return error.strerror or "it cannot be read"
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8"
    from pydantic import ValidationError  # noqa: PLC0415 - as above

    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    field = ".".join(map(str, first["loc"]))
    return f"{field}: {first['msg']}" if field else first["msg"]


class EvaluatorError(Exception):
    """Base class of all errors that this package raises on purpose."""


class UsageError(EvaluatorError):
    """The operator asked for something impossible. The message is one sentence."""


class StoreError(EvaluatorError):
    """A run folder cannot be read or written. The message is one sentence."""


class AgentError(EvaluatorError):
    """The agent cannot continue. The message is one sentence.

    Args:
        sentence: Error message.
        usage: Usage of the failed reply, if known.
    """

    def __init__(self, sentence: str, usage: "Usage | None" = None) -> None:
        super().__init__(sentence)
        self.usage = usage


class RefusedRequest(EvaluatorError):
    """A referee cannot fulfil a request; the message is one sentence.

    Args:
        status: HTTP status code of the response.
        sentence: Reason of the refusal, and what would work.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class InfrastructureError(EvaluatorError):
    """The server, the connection to it, or a worker process failed. The message is one sentence."""


class ServerFull(InfrastructureError):
    """The server is at its limit of open episodes."""


class PermanentFailure(InfrastructureError):
    """A retry cannot help: the API key or a setting is refused, the model is unknown, or the credit is used up."""
