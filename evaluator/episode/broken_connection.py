"""What a broken connection to a server means: an error of our own inside it, or a failed server with its last words."""

import socket
import ssl
from collections.abc import Iterator
from typing import IO, cast

import httpx2

from evaluator.errors import EvaluatorError, InfrastructureError

_WORDED: tuple[tuple[type[Exception], str], ...] = (
    (socket.gaierror, "no machine of that name is known"),
    (ssl.SSLError, "no secure connection can be made: its certificate is not trusted, or it does not speak TLS"),
    (FileNotFoundError, "there is no such program"),
    (PermissionError, "it may not be executed"),
    (
        httpx2.ConnectError,
        "nothing accepts connections there; start `physment-mcp serve` there, or correct the address",
    ),
    (httpx2.TimeoutException, "it did not answer in time"),
)
"""What errors of Python and its libraries mean, the most special first: their own words name no server."""


def server_failure(what: str, error: Exception, errors: IO[str]) -> InfrastructureError:
    """The error for a server process that failed, with the last line that it wrote.

    Args:
        what: What failed, as a clause.
        error: What the client noticed.
        errors: What the process wrote to stderr.
    """
    errors.seek(0)
    lines = [line.strip() for line in errors.read().splitlines() if line.strip()]
    return InfrastructureError(f"{what}: {lines[-1] if lines else reason(first_error(error))}")


def reason(error: BaseException) -> str:
    """Why there is no connection to a server, as a clause for the operator."""
    causes = list(_causes(error))
    worded = (clause for kind, clause in _WORDED if any(isinstance(cause, kind) for cause in causes))
    return next(worded, str(error) or repr(error))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """An error, what it was raised from, and so on."""
    while error is not None:
        yield error
        error = error.__cause__


def own_error(error: Exception, *kinds: type[EvaluatorError]) -> EvaluatorError | None:
    """An error of one of these kinds that a connected client wrapped; None if the error is of another kind."""
    first = first_error(error)
    return first if isinstance(first, kinds) else None


def first_error(error: BaseException) -> BaseException:
    """The first error inside exception groups that is not itself a group."""
    if isinstance(error, BaseExceptionGroup):
        parts = cast(BaseExceptionGroup[BaseException], error).exceptions
        return first_error(parts[0])
    return error


def without_seed(error: EvaluatorError, drawn: int, seed: int) -> EvaluatorError:
    """An error for the records, which must not hold the seed that a held-back variant was drawn from.

    Args:
        error: What went wrong.
        drawn: The seed that the variant was drawn from.
        seed: The seed as recorded.
    """
    if drawn == seed or str(drawn) not in str(error):
        return error
    return InfrastructureError(str(error).replace(str(drawn), f"(variant {seed})"))
