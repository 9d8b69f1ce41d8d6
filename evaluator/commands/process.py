"""What the program asks of its process before it loads a command: room for many episodes, and an end by signals."""

import contextlib
import gc
import signal
from importlib.util import find_spec
from types import FrameType

from physment_mcp.contract.command_line import restore_sigint

_OPEN_FILES = 65_536
"""Connections and files that may be open at a time, if the system allows it."""
_SIGNS = [sign for name in ("SIGINT", "SIGTERM", "SIGHUP") if (sign := getattr(signal, name, None)) is not None]
"""Signals that end the program; Windows has no SIGHUP. SIGINT is first, because the others pass for it."""


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


def end_in_order() -> None:
    """End at SIGTERM and SIGHUP as at Ctrl-C: what was started is ended, and every finished episode is on disk.

    Until it is called, these signals end the process without a word, because nothing has begun: an exception that a
    signal raises while modules are loaded may end anywhere. pydantic, as it builds a model, and an extension in C, as
    it starts, put an error of their own in its place.

    A signal that is ignored, as HUP is under `nohup`, stays ignored.
    """
    restore_sigint()
    for sign in _SIGNS[1:]:
        if signal.getsignal(sign) is signal.SIG_DFL:
            signal.signal(sign, _interrupt)


def end_at_once() -> None:
    """Let these signals end the process without a word again: all is done, and only Python has to end."""
    for sign in reversed(_SIGNS):
        if signal.getsignal(sign) not in {signal.SIG_IGN, None}:
            signal.signal(sign, signal.SIG_DFL)


def _interrupt(_sign: int, _frame: FrameType | None) -> None:
    # A script that starts this program in its background has SIGINT ignored; TERM must end the program even so.
    if signal.getsignal(signal.SIGINT) in {signal.SIG_IGN, None}:
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)
