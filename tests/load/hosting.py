"""A host process of our own, and what the system says about it. Linux only."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

MEGABYTE = 2**20


@dataclass(frozen=True)
class Hosted:
    """A running host."""

    port: int
    process: subprocess.Popen[str]

    @property
    def memory_mb(self) -> float:
        """Memory in use (resident set) [MB]."""
        pages = int((self._proc / "statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / MEGABYTE

    @property
    def open_files(self) -> int:
        """Files and connections that are open."""
        return len(list((self._proc / "fd").iterdir()))

    @property
    def threads(self) -> int:
        """Threads."""
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
def hosted(*options: str, environment: dict[str, str] | None = None) -> Generator[Hosted]:
    """Start a host on a free port of loopback; it ends with the context, and also if this process is killed.

    Args:
        options: Further options of `physment-mcp serve`.
        environment: Variables besides those of this process.
    """
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin", *options]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | (environment or {})
    ) as process:
        assert process.stdout is not None
        try:
            address: str = json.loads(process.stdout.readline())["listening"]
            yield Hosted(int(address.rpartition(":")[2]), process)
        finally:
            process.terminate()


def slope(values: Sequence[float], every_s: float) -> float:
    """The slope of a straight line through values at equal distances, by least squares [per hour]."""
    middle, mean = (len(values) - 1) / 2, sum(values) / len(values)
    spread = sum((place - middle) ** 2 for place in range(len(values)))
    rise = sum((place - middle) * (value - mean) for place, value in enumerate(values))
    return rise / spread / every_s * 3600 if spread else 0.0
