"""The program `physment-mcp`.

Its imports take about a second. During them, Ctrl-C ends the process at once, without a traceback.
"""

import signal
import sys
from typing import NoReturn


def entry() -> NoReturn:
    """Run the program `physment-mcp`."""
    _end_at_once()
    from physment_mcp.commands.program import main  # noqa: PLC0415 - see above

    code = main()
    _end_at_once()
    sys.exit(code)


def _end_at_once() -> None:
    """Let SIGINT end this process silently. Commands with something to clean up call `restore_sigint` when they start.

    A KeyboardInterrupt during the imports may be lost, because the engine raises another error in its place. An episode
    on stdio has nothing to clean up, and reads stdin in a thread that no exception interrupts.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    entry()
