"""What several commands use: declaring a command, running its async part, tables, the installed version."""

import argparse
import contextlib
import gc
import signal
from collections.abc import Awaitable, Callable
from importlib.metadata import version
from importlib.util import find_spec
from types import FrameType
from typing import Any, Protocol, TypeVar

import anyio
from rich.console import Console

from evaluator.errors import InfrastructureError, StoreError, UsageError

T = TypeVar("T")

_OPEN_FILES = 65_536
"""Connections and files that may be open at a time, if the system allows it."""


class Commands(Protocol):
    """Where a command is declared. `add_subparsers` returns it, with a type that argparse does not export."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        """The parser of a new command."""
        ...


def own_version() -> str:
    """Version of this package."""
    return version("physment-mcp")


def wide_console() -> Console:
    """A console for tables: as wide as the terminal, or wide enough for whole words if there is no terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=140)


def make_room() -> None:
    """Prepare this process for hundreds of open episodes, each with a connection and many long-lived objects."""
    # With the default thresholds, searching these objects for cycles took a third of the processor time of 500
    # episodes.
    gc.set_threshold(10_000, 20, 20)
    if find_spec("resource") is None:
        return  # Windows has no such limit
    import resource  # noqa: PLC0415

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # macOS may allow less than it reports
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def end_as_by_ctrl_c() -> None:
    """End at SIGTERM and SIGHUP as at Ctrl-C: what was started is ended, and every finished episode is on disk.

    A signal that is ignored, as HUP is under `nohup`, stays ignored.
    """
    for name in ("SIGTERM", "SIGHUP"):
        sign = getattr(signal, name, None)  # Windows has no SIGHUP
        if sign is not None and signal.getsignal(sign) is signal.SIG_DFL:
            signal.signal(sign, _interrupt)


def _interrupt(_sign: int, _frame: FrameType | None) -> None:
    # A script that starts this program in its background has SIGINT ignored; TERM must end the program even so.
    if signal.getsignal(signal.SIGINT) in {signal.SIG_IGN, None}:
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)


def run_async(play: Callable[[], Awaitable[T]]) -> T:
    """Run the async part of a command and return its result.

    Raises:
        KeyboardInterrupt: The operator pressed Ctrl-C.
        EvaluatorError: The first of our own errors in an exception group.
    """
    try:
        return anyio.run(play)
    except BaseExceptionGroup as group:
        for kind in (KeyboardInterrupt, UsageError, StoreError, InfrastructureError):
            found, _ = group.split(kind)
            while isinstance(found, BaseExceptionGroup):
                found = found.exceptions[0]
            if found is not None:
                raise found from None
        raise
