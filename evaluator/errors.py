"""The errors of the evaluator, and what follows from each of them.

EvaluatorError
├─ UsageError             the operator asked for something impossible      → one sentence, exit code 2
├─ StoreError             a run folder cannot be read or written           → one sentence, exit code 2
├─ AgentError             the agent cannot continue                        → recorded as the episode's outcome
├─ RefusedRequest         a referee cannot do what it is asked for      → the answer to the request, with its status
└─ InfrastructureError    server or connection failed                      → the episode is retried, never scored wrong
   └─ PermanentFailure    … and asking again cannot help                   → the agent's other episodes are left out
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # importing records takes a fifth of a second, and `--help` needs none
    from evaluator.records.episode import Usage


def reason_of(error: OSError | ValueError) -> str:
    """Why a file cannot be read, for a sentence: the word of the system, or the first problem of a record."""
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
    """The operator asked for something impossible; one sentence."""


class StoreError(EvaluatorError):
    """A run folder cannot be read or written; one sentence."""


class AgentError(EvaluatorError):
    """The agent cannot continue; one sentence.

    Args:
        sentence: Why.
        usage: Usage of the reply that failed, if it used anything.
    """

    def __init__(self, sentence: str, usage: "Usage | None" = None) -> None:
        super().__init__(sentence)
        self.usage = usage


class RefusedRequest(EvaluatorError):
    """A referee cannot do what it is asked for; one sentence.

    Args:
        status: The status of HTTP that says what kind of refusal it is.
        sentence: Why, and what would work.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class InfrastructureError(EvaluatorError):
    """The server or the connection to it failed; one sentence."""


class PermanentFailure(InfrastructureError):
    """Asking again cannot help: the key or a setting is refused, there is no such model, credit is used up."""
