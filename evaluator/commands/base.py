"""Shared code of the commands: argument types, shared options, running async code, consoles and sockets."""

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
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Any, Protocol, TypeVar

import anyio
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from evaluator.errors import InfrastructureError, StoreError, UsageError
from scenes import WorldError, one_world

PROMPTINGS = ("zero-shot", "one-shot-cot", "few-shot-cot")
"""Values of `--prompting`, which sets the number of worked examples in a prompt; the first is the default."""
PROTOCOLS = ("native", "text")
"""Formats in which agents write their calls; the first is the default."""


def count_of(things: str) -> Callable[[str], int]:
    """Create an argument type for whole numbers above 0.

    Args:
        things: Plural noun for the counted things, for error messages.
    """

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < 1:
            raise argparse.ArgumentTypeError(f"{text} is not a whole number of {things} above 0")
        return int(text)

    return read


def _above_zero(words: str) -> Callable[[str], float]:
    """Return an argument type for a number above 0, which `words` describe in error messages."""

    def read(text: str) -> float:
        value = _number(text)
        if not 0 < value < math.inf:
            raise argparse.ArgumentTypeError(f"{text} is not {words}")
        return value

    return read


seconds = _above_zero("a time above 0, in seconds")
"""Argument type: a duration above 0 [s]."""
logits = _above_zero("a standard error above 0, in logits")
"""Argument type: a standard error above 0 [logits]."""
us_dollars = _above_zero("an amount of money above 0, in US dollars")
"""Argument type: an amount of money above 0 [USD]."""


def temperature(text: str) -> float:
    """Argument type: a sampling temperature of a language model."""
    value = _number(text)
    if not 0 <= value <= 2:
        raise argparse.ArgumentTypeError(f"{text} is not a temperature from 0 to 2")
    return value


def scene_id(text: str) -> int:
    """Argument type: a scene id, or `world:LEVEL:INDEX`."""
    if text.startswith("world:"):
        try:
            return one_world(text)
        except WorldError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not the number of a scene")
    return int(text)


def seed(text: str) -> int:
    """Argument type: the seed of a scene's variant."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a seed, which is a whole number from 0")
    return int(text)


def price(text: str) -> float:
    """Argument type: a deduction from a reward, 0 or more."""
    value = _number(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a cost, which is a number from 0")
    return value


def port(text: str) -> int:
    """Argument type: a TCP port; 0 lets the system choose."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; ports are 0 to 65535")
    return int(text)


def folder_to_write(text: str) -> Path:
    """Argument type: a folder that exists or can be created.

    Raises:
        UsageError: The path or one of its parents is a file.
    """
    path = Path(text)
    _refuse_file_on_the_way(path, path)
    return path


def file_to_write(text: str) -> Path:
    """Argument type: a file that exists or can be created.

    Raises:
        UsageError: The path is a folder, or one of its parents is a file.
    """
    path = Path(text)
    _refuse_file_on_the_way(path, path.parent)
    if path.is_dir():
        raise UsageError(f"{path} cannot be written: it is a folder, and a file is needed")
    return path


def _refuse_file_on_the_way(path: Path, folder: Path) -> None:
    """Check early that no parent of an output path is a file.

    Raises:
        UsageError: The nearest existing parent is a file or cannot be accessed.
    """
    try:
        found = next((part for part in (folder, *folder.parents) if part.exists()), None)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from error
    if found is not None and not found.is_dir():
        name = "it" if found == path else str(found)
        raise UsageError(f"{path} cannot be written: {name} is a file, and a folder is needed")


def _number(text: str) -> float:
    """Parse a number; NaN, which fails every range check, if the text is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan


OptionGroup = argparse._ActionsContainer  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - has no public name
"""A parser or a group of its options: what options are declared on."""


def seed_key(parser: OptionGroup) -> None:
    """Declare the option `--seed-key` for a command that reads stored runs."""
    parser.add_argument(
        "--seed-key",
        type=Path,
        metavar="FILE",
        help="the key of a run on held-back seeds (default: the one that its folder reveals)",
    )


def unproved(parser: OptionGroup) -> None:
    """Declare the option `--unproved`."""
    parser.add_argument(
        "--unproved",
        action="store_true",
        help="do not prove seeds that no certificate covers (default: the reference protocol and the engine prove each"
        " before it is played, a few seconds once; one that fails is left out)",
    )


def allow_modified(parser: OptionGroup) -> None:
    """Declare the option `--allow-modified`."""
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
    command.add_argument(
        "--allow-other-packs",
        action="store_true",
        help="grade scenes that were played on another version of their pack with the key of the one here",
    )
    command.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")


T = TypeVar("T")


class Commands(Protocol):
    """The object that `add_subparsers` returns, on which commands are declared. argparse does not export its type."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        """Add a command and return its parser."""
        ...


def wide_console() -> Console:
    """Create a console for tables. Without a terminal, it is wide enough that no words are broken."""
    console = Console()
    return console if console.is_terminal else Console(width=140)


def results_console(*, as_json: bool) -> Console:
    """Create the console for tables of a command, which is stderr if the command prints JSON on stdout."""
    return Console(stderr=as_json)


def usual_folder(label: str) -> Path:
    """The folder of a new run whose command names none: `runs/TIME-LABEL`."""
    return Path("runs") / f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{label}"


def progress_bar(console: Console | None = None, *, last: str = "") -> Progress:
    """Create a progress bar, which is shown only on a terminal and disappears at the end.

    Args:
        console: Console that shows it; None for stderr.
        last: Field of the task that is shown after the times; empty for none.
    """
    console = console or Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    columns = (*columns, TimeRemainingColumn(), *([TextColumn(f"{{task.fields[{last}]}}")] if last else []))
    return Progress(*columns, console=console, disable=not console.is_terminal, transient=True)


def run_async(play: Callable[[], Awaitable[T]]) -> T:
    """Run the async part of a command and return its result.

    Raises:
        KeyboardInterrupt: The operator pressed Ctrl-C, or a signal ended the program.
        EvaluatorError: The first `EvaluatorError` in an exception group.
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
    """Await the work. SIGTERM and SIGHUP cancel it at its next `await`, as Ctrl-C does under asyncio.

    The usual handler of both passes them on as SIGINT, which asyncio handles. A background job of a script ignores
    SIGINT. The usual handler would then raise KeyboardInterrupt in the middle of any function, and the program would
    end with a traceback.
    """
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None
    signs = (getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP"))  # Windows has no SIGHUP
    usual = {sign: taken for sign in signs if sign is not None and callable(taken := signal.getsignal(sign))}

    def let_usual() -> None:
        for sign, taken in usual.items():
            signal.signal(sign, taken)

    def cancel(_sign: int, _frame: FrameType | None) -> None:
        let_usual()  # a second signal ends the process at once
        loop.call_soon_threadsafe(task.cancel)

    for sign in usual:
        signal.signal(sign, cancel)
    try:
        return await play()
    finally:
        let_usual()


def listening(address: str, number: int) -> socket.socket:
    """Create a listening TCP socket.

    Args:
        address: Address to bind.
        number: Port to bind; 0 for any free port.

    Raises:
        UsageError: The port is in use, or the address does not belong to this machine.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listener = socket.create_server((address.strip("[]"), number), family=family)
    except OSError as error:
        raise UsageError(f"cannot listen on {address} port {number}: {error.strerror}") from error
    # Nagle's algorithm would delay small packets, which costs 40 ms per request.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def page_token() -> str:
    """Create a random token for the URL of a page, so that the URL cannot be guessed."""
    return secrets.token_urlsafe(16)


def open_page(address: str) -> None:
    """Open a page in a graphical browser. Does nothing without a display: a text browser would occupy the terminal."""
    if sys.platform in {"win32", "darwin"} or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
