"""Starts a host process and reads its resource usage from the operating system. Linux only."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

MEGABYTE = 2**20


@dataclass(frozen=True)
class Hosted:
    """A running host."""

    port: int
    process: subprocess.Popen[str]
    log: IO[str]
    """Standard error of the host."""

    def errors(self) -> list[str]:
        """Lines of the log that report exceptions in the host or in a library."""
        self.log.seek(0)
        return [line.rstrip() for line in self.log if line.startswith(("ERROR", "CRITICAL", "Traceback"))]

    @property
    def memory_mb(self) -> float:
        """Memory in use (resident set) [MB]."""
        pages = int((self._proc / "statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / MEGABYTE

    @property
    def open_files(self) -> int:
        """Number of open files and connections."""
        return len(list((self._proc / "fd").iterdir()))

    @property
    def threads(self) -> int:
        """Number of threads."""
        return len(list((self._proc / "task").iterdir()))

    @property
    def processor_s(self) -> float:
        """Processor time used so far [s]."""
        fields = (self._proc / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    @property
    def _proc(self) -> Path:
        return Path("/proc") / str(self.process.pid)


@contextlib.contextmanager
def hosted(*options: str) -> Generator[Hosted]:
    """Start a host on a free port of loopback; it ends with the context, and also if this process is killed.

    Args:
        options: Further options of `physment-mcp serve`.
    """
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin", *options]
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as log,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True) as process,
    ):
        assert process.stdout is not None
        try:
            address: str = json.loads(process.stdout.readline())["listening"]
            yield Hosted(int(address.rpartition(":")[2]), process, log)
        finally:
            process.terminate()
