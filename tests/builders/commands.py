"""Runs commands of `physment-eval` in this process, which saves a second of imports; resets signal handlers."""

import contextlib
import io
import signal
import sys
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from evaluator.commands.program import main


@dataclass(frozen=True, slots=True)
class Done:
    """The exit code of a command, and its output."""

    returncode: int
    stdout: str
    stderr: str


def physment_eval(*words: str | Path, typed: str = "", cwd: Path | None = None) -> Done:
    """Run a command.

    Args:
        words: The arguments of the command.
        typed: Text on its standard input, which is not a terminal.
        cwd: Working directory; None for the working directory of the tests.
    """
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        _reading(io.StringIO(typed)),
        contextlib.chdir(cwd or "."),
    ):
        try:
            code = main([str(word) for word in words])
        except SystemExit as ended:
            code = ended.code
    assert isinstance(code, int)
    return Done(code, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def _reading(stdin: io.StringIO) -> Generator[None]:
    before, sys.stdin = sys.stdin, stdin
    try:
        yield
    finally:
        sys.stdin = before


def heed_signals() -> None:
    """Restore the default signal handling in a started program, which would inherit ignored signals from nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
