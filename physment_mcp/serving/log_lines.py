"""Log lines that never stop the program: a full or unread standard error loses lines instead of blocking."""

import contextlib
import logging
import queue
import sys
import threading
import time

_WAITING = 1000
"""Most lines that wait to be written; further ones are lost."""
_LAST_S = 0.5
"""Wall time that the last lines get when the program ends [s]."""


class PatientLines(logging.Handler):
    """Hands lines to a thread that writes them to standard error."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: queue.Queue[str] = queue.Queue(_WAITING)
        self._writer: threading.Thread | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Take a line, or lose it if too many wait. `logging` calls this in one thread at a time."""
        if self._writer is None:  # not earlier: a process with threads should not fork
            self._writer = threading.Thread(target=self._write, name="log", daemon=True)
            self._writer.start()
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(self.format(record) + "\n")

    def close(self) -> None:
        """Give the last lines some time. `logging` calls this when the program ends."""
        until = time.monotonic() + _LAST_S
        while self._lines.unfinished_tasks and time.monotonic() < until:
            time.sleep(0.005)
        super().close()

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            with contextlib.suppress(OSError, ValueError):  # nobody reads it any more
                sys.stderr.write(line)
                sys.stderr.flush()
            self._lines.task_done()
