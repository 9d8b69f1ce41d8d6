"""What several commands use: types of arguments, declaring a command, running its async part, tables, sockets."""

import argparse
import asyncio
import math
import os
import secrets
import signal
import socket
import sys
import webbrowser
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import anyio
from rich.console import Console

from evaluator.errors import InfrastructureError, StoreError, UsageError
from scenes import WorldError, one_world

if TYPE_CHECKING:
    from argparse import _ActionsContainer as ActionsContainer  # pyright: ignore[reportPrivateUsage] - has no public name

PROMPTINGS = ("zero-shot", "one-shot-cot", "few-shot-cot")
"""How many worked examples a prompt shows; the first is the usual one."""
PROTOCOLS = ("native", "text")
"""How agents write their calls; the first is the usual one."""


def count_of(things: str) -> Callable[[str], int]:
    """The type of a whole number above 0.

    Args:
        things: What is counted, in the plural.
    """

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < 1:
            raise argparse.ArgumentTypeError(f"{text} is not a whole number of {things} above 0")
        return int(text)

    return read


def seconds(text: str) -> float:
    """A time above 0 [s]."""
    value = _number(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a time above 0, in seconds")
    return value


def us_dollars(text: str) -> float:
    """An amount of money above 0 [USD]."""
    value = _number(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not an amount of money above 0, in US dollars")
    return value


def temperature(text: str) -> float:
    """A sampling temperature."""
    value = _number(text)
    if not 0 <= value <= 2:
        raise argparse.ArgumentTypeError(f"{text} is not a temperature from 0 to 2")
    return value


def scene_id(text: str) -> int:
    """The number of a scene, or `world:LEVEL:INDEX`."""
    if text.startswith("world:"):
        try:
            return one_world(text)
        except WorldError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not the number of a scene")
    return int(text)


def seed(text: str) -> int:
    """The number of a variant of a scene."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a seed, which is a whole number from 0")
    return int(text)


def price(text: str) -> float:
    """What is taken off a reward, 0 or more."""
    value = _number(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a cost, which is a number from 0")
    return value


def port(text: str) -> int:
    """A TCP port; 0 lets the system choose."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; ports are 0 to 65535")
    return int(text)


def folder_to_write(text: str) -> Path:
    """A folder that exists or can be made.

    Raises:
        UsageError: A file is in its place or above it.
    """
    path = Path(text)
    _refuse_file_on_the_way(path, path)
    return path


def file_to_write(text: str) -> Path:
    """A file that exists or can be made.

    Raises:
        UsageError: A folder is in its place, or a file above it.
    """
    path = Path(text)
    _refuse_file_on_the_way(path, path.parent)
    if path.is_dir():
        raise UsageError(f"{path} cannot be written: it is a folder, and a file is needed")
    return path


def _refuse_file_on_the_way(path: Path, folder: Path) -> None:
    """Refuse to write to a path below a file, before any work is done for it.

    Raises:
        UsageError: The nearest part of the folder that exists is a file, or cannot be looked at.
    """
    try:
        found = next((part for part in (folder, *folder.parents) if part.exists()), None)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from error
    if found is not None and not found.is_dir():
        name = "it" if found == path else str(found)
        raise UsageError(f"{path} cannot be written: {name} is a file, and a folder is needed")


def _number(text: str) -> float:
    """The number that a text is; NaN, which is in no range, if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def seed_key(parser: "ActionsContainer") -> None:
    """Declare `--seed-key` of a command that reads stored runs."""
    parser.add_argument(
        "--seed-key",
        type=Path,
        metavar="FILE",
        help="the key of a run on held-back seeds (default: the one that its folder reveals)",
    )


def allow_modified(parser: "ActionsContainer") -> None:
    """Declare `--allow-modified`."""
    parser.add_argument(
        "--allow-modified",
        action="store_true",
        help="go on with records that are not as they were sealed at the end of their run; the report says so",
    )


def stored_run_options(command: argparse.ArgumentParser) -> None:
    """Declare the options of commands that grade stored episodes."""
    allow_modified(command)
    seed_key(command)
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
    command.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")


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


def listening(address: str, number: int) -> socket.socket:
    """A socket that listens.

    Args:
        address: On which address.
        number: On which port; 0 for any free one.

    Raises:
        UsageError: The port is taken, or the address is not of this machine.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listener = socket.create_server((address.strip("[]"), number), family=family)
    except OSError as error:
        raise UsageError(f"cannot listen on {address} port {number}: {error.strerror}") from error
    # Otherwise the system holds small packets back, which costs 40 ms a request.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def page_token() -> str:
    """A token for the address of a page, which nobody guesses."""
    return secrets.token_urlsafe(16)


def open_page(address: str) -> None:
    """Open a page in the browser, where there is a screen: a browser in the terminal would take the terminal."""
    if sys.platform in {"win32", "darwin"} or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
