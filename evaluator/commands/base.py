"""What several commands use: declaring a command, running its async part, tables."""

import argparse
import asyncio
import signal
from collections.abc import Awaitable, Callable
from types import FrameType
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
        KeyboardInterrupt: The operator pressed Ctrl-C, or a signal ended the program.
        EvaluatorError: The first of our own errors in an exception group.
    """
    try:
        return anyio.run(_until_signalled, play)
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None
    except BaseExceptionGroup as group:
        for kind in (KeyboardInterrupt, UsageError, StoreError, InfrastructureError):
            found, _ = group.split(kind)
            while isinstance(found, BaseExceptionGroup):
                found = found.exceptions[0]
            if found is not None:
                raise found from None
        raise


async def _until_signalled(play: Callable[[], Awaitable[T]]) -> T:
    """Do the work; SIGTERM and SIGHUP cancel it where it awaits something, as asyncio does it for Ctrl-C.

    asyncio leaves Ctrl-C alone where it is ignored, as in the background of a script. Without this, the exception of a
    signal would then be raised in the middle of any function, of a library too, and end the program with a traceback.
    """
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None
    signs = (getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP"))  # Windows has no SIGHUP
    usual = {sign: taken for sign in signs if sign is not None and callable(taken := signal.getsignal(sign))}

    def let_usual() -> None:
        for sign, taken in usual.items():
            signal.signal(sign, taken)

    def cancel(_sign: int, _frame: FrameType | None) -> None:
        let_usual()  # so a second signal does not wait
        loop.call_soon_threadsafe(task.cancel)

    for sign in usual:
        signal.signal(sign, cancel)
    try:
        return await play()
    finally:
        let_usual()
