"""Measures how much one hostile client slows honest clients, for each kind of attack.

A host serves honest clients, each with its own episode and at a typical pace. Time windows without and with one
attacker alternate. The slowest call of each window is taken; the ratio is the median of these over windows with the
attacker, divided by the median over windows without. A ratio above the aim is marked but is not a failure, because
other processes disturb the measurement. A failed honest call is a failure.

python -m tests.harness.load.hostile [--kinds WORD,…] [--clients N] [--repeats N] [--window S]
"""

import argparse
import asyncio
import contextlib
import gc
import json
import statistics
import sys
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass, field

from rich.console import Console
from rich.table import Table

from tests.harness.load.attacks import ATTACKS
from tests.harness.load.honest import Crowd
from tests.harness.load.hosting import Hosted, hosted

AIM = 3.0
"""Largest ratio that is not marked as above the aim."""
_SETTLING_S = 0.3
"""Pause between the end of an attack and the next window [s]."""


@dataclass
class Window:
    """The honest calls that ended in one time window."""

    took_s: list[float]
    busy: float
    """Share of one processor that the host used."""

    @property
    def median_ms(self) -> float:
        """Duration of the median call [ms]."""
        return 1000 * statistics.median(self.took_s)

    @property
    def slowest_ms(self) -> float:
        """Duration of the slowest call [ms]."""
        return 1000 * max(self.took_s)


@dataclass
class Compared:
    """The windows without and with an attack."""

    usual: list[Window] = field(default_factory=list[Window])
    attacked: list[Window] = field(default_factory=list[Window])
    sent: int = 0
    sent_bytes: int = 0
    refused: int = 0

    @property
    def ratio(self) -> float:
        """Ratio of the slowest call's duration with and without the attack."""
        usual, attacked = (statistics.median(one.slowest_ms for one in side) for side in (self.usual, self.attacked))
        return attacked / usual

    def row(self) -> list[str]:
        """Return the cells of this attack's row in the table, without its name."""

        def middle(windows: list[Window], name: str) -> str:
            return f"{statistics.median(getattr(one, name) for one in windows):.1f}"

        return [
            f"{self.sent:,}",
            f"{self.sent_bytes / 1e6:.1f}",
            f"{self.refused:,}",
            f"{statistics.median(one.busy for one in self.attacked):.0%}",
            middle(self.usual, "median_ms"),
            middle(self.attacked, "median_ms"),
            middle(self.usual, "slowest_ms"),
            middle(self.attacked, "slowest_ms"),
            f"{self.ratio:.1f}" + ("" if self.ratio <= AIM else "  above"),
        ]


@contextlib.asynccontextmanager
async def attacking(port: int, kind: str) -> AsyncGenerator[dict[str, int]]:
    """Attack a host from another process; at the end of the context, the yielded dictionary contains its counts."""
    words = ["-m", "tests.harness.load.attacks", str(port), kind]
    process = await asyncio.create_subprocess_exec(
        sys.executable, *words, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert process.stdin is not None
    assert process.stdout is not None
    counts: dict[str, int] = {}
    try:
        await process.stdout.readline()
        yield counts
    finally:
        process.stdin.close()
        said = await process.stdout.read()
        await process.wait()
        counts |= json.loads(said or "{}")


async def window(host: Hosted, crowd: Crowd, seconds: float) -> Window:
    """Wait for some wall time; returns the honest calls that ended in it."""
    crowd.take()
    busy = host.processor_s
    await asyncio.sleep(seconds)
    return Window(crowd.take(), (host.processor_s - busy) / seconds)


async def compare(host: Hosted, crowd: Crowd, kind: str, repeats: int, seconds: float) -> Compared:
    """Measure honest calls with and without one kind of attack, in alternating windows."""
    found = Compared([await window(host, crowd, seconds)])
    for _ in range(repeats):
        async with attacking(host.port, kind) as counts:
            found.attacked.append(await window(host, crowd, seconds))
        found.sent += counts["sent"]
        found.sent_bytes += counts["sent_bytes"]
        found.refused += counts["refused"]
        await asyncio.sleep(_SETTLING_S)
        found.usual.append(await window(host, crowd, seconds))
    return found


async def run(kinds: Sequence[str], clients: int, repeats: int, seconds: float, console: Console) -> int:
    """Measure, and print a table; returns how many honest calls failed."""
    table = Table(title=f"{clients} honest clients, medians of {repeats} repeats", box=None)
    for title in ("attack", "sent", "MB", "refused", "host busy", "median ms", "under attack", "slowest ms"):
        table.add_column(title, justify="left" if title == "attack" else "right")
    table.add_column("under attack", justify="right")
    table.add_column("ratio", justify="right")
    with hosted() as host:
        crowd = Crowd(host.port, clients)
        playing = asyncio.ensure_future(crowd.play())
        await window(host, crowd, 2.0)
        gc.freeze()
        for kind in kinds:
            found = await compare(host, crowd, kind, repeats, seconds)
            table.add_row(kind, *found.row())
            console.print(f"{kind}: {found.ratio:.1f}", highlight=False)
        playing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await playing
    console.print(table)
    for failure in crowd.failures[:5]:
        console.print(f"an honest call failed: {failure}", style="red", highlight=False, markup=False)
    return len(crowd.failures)


def main(argv: Sequence[str]) -> int:
    """Measure every kind of attack; returns 1 if an honest call failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", default="", help=f"words in the names of: {' · '.join(ATTACKS)}")
    parser.add_argument("--clients", type=int, default=50, help="honest clients (50)")
    parser.add_argument("--repeats", type=int, default=3, help="windows under each attack (3)")
    parser.add_argument("--window", type=float, default=4.0, help="wall time of a window [s] (4)")
    args = parser.parse_args(argv)
    words = args.kinds.split(",")
    kinds = [kind for kind in ATTACKS if any(word in kind for word in words)]
    failures = asyncio.run(run(kinds, args.clients, args.repeats, args.window, Console(width=150)))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
