"""Shared code of the commands: how they are declared, common options, argument types, errors of writing."""

import argparse
import math
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from physment_mcp.errors import SceneError, UsageError
from scenes import PackError
from scenes.errors import WorldError
from scenes.world_names import one_world

_MOST = 10_000
"""Longest accepted range of numbers; a longer one is assumed to be a mistake."""


class Commands(Protocol):
    """The object that `add_subparsers` returns, whose type argparse does not publish."""

    def add_parser(self, name: str, **kwargs: Any) -> argparse.ArgumentParser:
        """Declare a command."""
        ...


def common_options(*, again: bool = False) -> argparse.ArgumentParser:
    """Return the options that may be given before or after the name of a command.

    Args:
        again: True for the options after the name. An option that is not given there keeps the value given before the
            name.
    """
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS if again else None)
    common.add_argument(
        "--scenes-dir",
        type=Path,
        metavar="DIR",
        help="folder of scene packs (Scene7/scene7.json, …); default: the suite",
    )
    common.add_argument(
        "--log-level",
        choices=["debug", "info", "warning", "error"],
        default=argparse.SUPPRESS if again else "warning",
        help="to stderr",
    )
    return common


def observations(command: argparse.ArgumentParser, *, again: bool = False) -> None:
    """Declare `--observations`; `again` as in `common_options`."""
    command.add_argument(
        "--observations",
        choices=["text", "rgb"],
        default=argparse.SUPPRESS if again else "text",
        help="rgb: results of step and find_objects carry a picture of what may be seen (default text)",
    )


def timestep(command: argparse.ArgumentParser, *, again: bool = False) -> None:
    """Declare `--timestep`; `again` as in `common_options`."""
    command.add_argument(
        "--timestep",
        type=positive(float),
        metavar="S",
        default=argparse.SUPPRESS if again else None,
        help="time step in s, such as 0.005, instead of the one in the scene's model",
    )


@contextmanager
def writing(target: Path) -> Generator[None]:
    """Convert errors that occur while the block writes to `target` to errors with a message of one sentence.

    Raises:
        SceneError: A pack is missing or malformed, or cannot be exported to `target`.
        UsageError: The operating system refuses to write to the target.
    """
    try:
        yield
    except PackError as error:
        raise SceneError(str(error)) from error
    except OSError as error:
        raise UsageError(f"cannot write {target}: {error.strerror}") from error


def numbers(text: str) -> list[int]:
    """Argument type: a list of whole numbers and ranges, such as `7,21-30`."""
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        last = last if dash else first
        if not (first.isdecimal() and last.isdecimal() and len(last) < 10 and 0 <= int(last) - int(first) < _MOST):
            raise argparse.ArgumentTypeError(f"{text!r} is not a list of whole numbers, such as 7,21-30")
        found |= set(range(int(first), int(last) + 1))
    return sorted(found)


def port(text: str) -> int:
    """Argument type: a TCP port; 0 lets the system choose."""
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; ports are 0 to 65535")
    return int(text)


def scene_id(text: str) -> int:
    """Argument type: the number of a scene, or a reference to a world."""
    if not text.startswith("world:"):
        return whole_number(text)
    try:
        return one_world(text)
    except WorldError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def whole_number(text: str) -> int:
    """Argument type: a whole number, which may be negative."""
    if not text.removeprefix("-").isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number")
    return int(text)


def positive(kind: type[int] | type[float]) -> "partial[int | float]":
    """Argument type: a finite number above 0."""

    def parse(kind: type[int] | type[float], text: str) -> int | float:
        try:
            value = kind(text)
        except ValueError:
            value = kind(0)
        if not (value > 0 and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"{text} is not a {'whole ' if kind is int else ''}number above 0")
        return value

    return partial(parse, kind)
