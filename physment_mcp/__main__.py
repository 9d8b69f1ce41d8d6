"""The program `physment-mcp`. Loading everything else takes a second; Ctrl-C ends the process at once meanwhile."""

import signal
import sys
from typing import NoReturn


def entry() -> NoReturn:
    """Be the program `physment-mcp`."""
    _end_at_once()
    from physment_mcp.commands.program import main  # noqa: PLC0415 - see above

    code = main()
    _end_at_once()
    sys.exit(code)


def _end_at_once() -> None:
    """Let Ctrl-C end this process without a word. Commands that can clean up undo it at their start: `restore_sigint`.

    An exception that it raises while modules are loaded may end anywhere: the engine, as it starts, puts an error of
    its own in its place. An episode on stdio has nothing to clean up, and waits for the next line in a thread, which no
    exception ends.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    entry()
