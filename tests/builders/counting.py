"""Counts the calls of functions while a block runs, without patching the functions."""

import sys
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any


@contextmanager
def calls_counted(*functions: Callable[..., Any]) -> Generator[Counter[str]]:
    """Count the calls of some functions in this thread.

    Args:
        functions: Python functions. Generators are not supported, because each resumption would count as a call.

    Yields:
        Name of the function → its calls so far.
    """
    names = {function.__code__: function.__qualname__ for function in functions}
    calls: Counter[str] = Counter()

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call" and frame.f_code in names:
            calls[names[frame.f_code]] += 1

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        yield calls
    finally:
        sys.setprofile(before)


def calls_made(work: Callable[[], object]) -> int:
    """Return the number of function calls, C functions included, that `work` makes; the same on every machine."""
    calls = 0

    def note(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in {"call", "c_call"}

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    return calls
