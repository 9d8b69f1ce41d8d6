"""What the commands share: whole numbers, our own errors out of exception groups, the installed version."""

import argparse
import contextlib
import gc
import math
from collections.abc import Awaitable, Callable
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any, Protocol

import anyio
from rich.console import Console

from evaluator.errors import InfrastructureError, StoreError, UsageError

_OPEN_FILES = 65_536
"""Connections and files that may be open at a time, where the system lets us choose."""


class Commands(Protocol):
    """Where a command is declared: what `add_subparsers` returns, a type argparse keeps to itself."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        """The parser of a new command."""
        ...


def own_version() -> str:
    """Version of this package."""
    return version("physment-mcp")


def wide_console() -> Console:
    """A console for tables: as wide as the terminal, and wide enough for whole words where there is none."""
    console = Console()
    return console if console.is_terminal else Console(width=140)


def whole(text: str) -> int:
    """A whole number above 0, as an argument type."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above 0")
    return int(text)


def seconds(text: str) -> float:
    """A time above 0 [s], as an argument type."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a time above 0, in seconds")
    return value


def make_room() -> None:
    """Prepare this process for hundreds of open episodes, each with a connection and many objects that live long."""
    # Looking at those objects again and again for cycles took a third of the processor time of 500 episodes.
    gc.set_threshold(10_000, 20, 20)
    if find_spec("resource") is None:
        return  # Windows has no such limit
    import resource  # noqa: PLC0415

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # macOS may allow less than it says
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def unwrapped(play: Callable[[], Awaitable[object]]) -> None:
    """Run the async part; of an exception group raise the first of our own errors."""
    try:
        anyio.run(play)
    except BaseExceptionGroup as group:
        for kind in (KeyboardInterrupt, UsageError, StoreError, InfrastructureError):
            found, _ = group.split(kind)
            while isinstance(found, BaseExceptionGroup):
                found = found.exceptions[0]
            if found is not None:
                raise found from None
        raise
