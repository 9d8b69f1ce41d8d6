"""Tests of the error messages for failed connections."""

import socket
import ssl

import httpx2
import pytest

from evaluator.episode.connections import reason


@pytest.mark.parametrize(
    ("cause", "clause"),
    [
        (socket.gaierror(-2, "Name or service not known"), "no machine of that name is known"),
        (ssl.SSLCertVerificationError(1, "certificate verify failed"), "no secure connection can be made"),
        (OSError("All connection attempts failed"), "nothing accepts connections there; start `physment-mcp serve`"),
    ],
)
def test_what_is_behind_a_connection_error_is_told_in_plain_words(cause: Exception, clause: str) -> None:
    error = httpx2.ConnectError(str(cause))
    error.__cause__ = cause
    told = reason(error)
    assert told.startswith(clause)
    assert str(cause) not in told


def test_an_error_without_words_is_named_by_its_kind() -> None:
    assert reason(httpx2.ReadTimeout("")) == "it did not answer in time"
    assert reason(EOFError()) == "EOFError()"
    assert reason(RuntimeError("it ended at once")) == "it ended at once"
