"""Types of command-line arguments. Each reads one quantity, and its error names that quantity with its unit."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from argparse import _ActionsContainer as ActionsContainer  # pyright: ignore[reportPrivateUsage] - has no public name


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
    """The number of a scene."""
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


def trust_edited(parser: "ActionsContainer") -> None:
    """Declare `--trust-edited`."""
    parser.add_argument(
        "--trust-edited",
        action="store_true",
        help="go on with records that are not as they were sealed at the end of their run; the report says so",
    )
