"""Entry point of `physment-eval`. During its imports, Ctrl-C ends the process at once, without a traceback."""

import signal
import sys
from typing import NoReturn


def entry() -> NoReturn:
    """Run the program `physment-eval`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not if SIGINT is ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # the default action, as for SIGTERM and SIGHUP
    from evaluator.commands.program import end_at_once, end_in_order, main  # noqa: PLC0415

    code = main(begin=end_in_order)
    end_at_once()
    sys.exit(code)


if __name__ == "__main__":
    entry()
