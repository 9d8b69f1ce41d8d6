"""What several commands use: declaring a command, running its async part, tables."""

import argparse
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, TypeVar

import anyio
from rich.console import Console

from evaluator.errors import InfrastructureError, StoreError, UsageError

T = TypeVar("T")


class Commands(Protocol):
    """Where a command is declared. `add_subparsers` returns it, with a type that argparse does not export."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        """The parser of a new command."""
        ...


def wide_console() -> Console:
    """A console for tables: as wide as the terminal, or wide enough for whole words if there is no terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=140)


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
