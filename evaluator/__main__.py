"""The program `physment-eval`. Loading everything else takes a second; a signal ends the process at once meanwhile."""

import signal
import sys
from typing import NoReturn


def entry() -> NoReturn:
    """Be the program `physment-eval`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # as SIGTERM and SIGHUP still are
    from evaluator.commands.program import end_at_once, end_in_order, main  # noqa: PLC0415

    code = main(begin=end_in_order)
    end_at_once()
    sys.exit(code)


if __name__ == "__main__":
    entry()
