"""Translates connection failures into errors of this package, with the cause or the server's last output."""

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
"""Messages for exceptions of Python and its libraries, whose own messages name no server; most specific first."""


def server_failure(what: str, error: Exception, errors: IO[str]) -> InfrastructureError:
    """Build the error for a server process that failed, with the last line that it wrote.

    Args:
        what: What failed, as a clause.
        error: Exception that the client raised.
        errors: Captured stderr of the process.
    """
    errors.seek(0)
    lines = [line.strip() for line in errors.read().splitlines() if line.strip()]
    return InfrastructureError(f"{what}: {lines[-1] if lines else reason(first_error(error))}")


def reason(error: BaseException) -> str:
    """Explain in a clause why a server cannot be reached."""
    causes = list(_causes(error))
    worded = (clause for kind, clause in _WORDED if any(isinstance(cause, kind) for cause in causes))
    return next(worded, str(error) or repr(error))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and its chain of causes."""
    while error is not None:
        yield error
        error = error.__cause__


def own_error(error: Exception, *kinds: type[EvaluatorError]) -> EvaluatorError | None:
    """Return the wrapped error if it is of one of these types, otherwise None."""
    first = first_error(error)
    return first if isinstance(first, kinds) else None


def first_error(error: BaseException) -> BaseException:
    """Return the first error inside nested exception groups."""
    if isinstance(error, BaseExceptionGroup):
        parts = cast(BaseExceptionGroup[BaseException], error).exceptions
        return first_error(parts[0])
    return error


def without_seed(error: EvaluatorError, drawn: int, seed: int) -> EvaluatorError:
    """Remove a held-back seed from an error message, because records must not contain it.

    Args:
        error: The error.
        drawn: The secret seed from which the variant was sampled.
        seed: The seed as recorded.
    """
    if drawn == seed or str(drawn) not in str(error):
        return error
    return InfrastructureError(str(error).replace(str(drawn), f"(variant {seed})"))
