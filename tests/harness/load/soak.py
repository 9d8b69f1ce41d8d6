"""Soak test: half an hour of honest and hostile clients on one host, with samples of its memory, files and speed.

Honest clients play one episode after another and leave every fifth to expire; the attacks take turns. After a warm-up
of a quarter of the samples, a straight line through the samples of each quantity must not rise by more than the share
of its mean that `LIMITS` names. In the end, every episode and every connection must be closed. The exit code is 1 if
this does not hold, or an honest call failed, or the host logged an error.

python -m tests.harness.load.soak [--minutes M] [--clients N] [--every S] [--idle-timeout S]
"""

import argparse
import asyncio
import contextlib
import itertools
import json
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

from rich.console import Console
from rich.table import Table

from tests.harness.load.attacks import ATTACKS
from tests.harness.load.honest import Crowd
from tests.harness.load.hostile import attacking
from tests.harness.load.hosting import Hosted, hosted
from tests.harness.load.wire import Connection, request

LIMITS = {"memory_mb": 0.10, "open_files": 0.25, "threads": 0.25, "episodes": 0.25, "median_ms": 0.50}
"""Quantity → largest rise after the warm-up, as a share of its mean. The attacks differ, so a rise is judged only after
two rounds of them; the slowest call depends too much on other processes to be judged."""
_WARM_UP = 4
"""The first 1/_WARM_UP of the samples belong to the warm-up and are not judged."""
_CALLS_EACH = 40
"""Calls in an honest episode."""
_PATIENCE_S = 60.0
"""Time for the host to close episodes and connections, in addition to the idle timeout of episodes [s]."""


@dataclass(frozen=True)
class Sample:
    """The state of the host at the end of a sampling interval, and the honest calls in the interval."""

    time_s: float
    memory_mb: float
    open_files: int
    threads: int
    episodes: int
    calls: int
    median_ms: float
    slowest_ms: float


@dataclass
class Soaked:
    """The samples and problems of a soak test."""

    samples: list[Sample] = field(default_factory=list[Sample])
    attacks: list[str] = field(default_factory=list[str])
    """The attack of each sample."""
    problems: list[str] = field(default_factory=list[str])
    """Honest calls that failed, attackers that died, errors in the log, connections and episodes that stayed open."""

    def rises(self) -> dict[str, float]:
        """Return, for each measured quantity of the host, its rise after the warm-up as a share of its mean."""
        judged = self.samples[len(self.samples) // _WARM_UP :]
        return {name: rise([getattr(sample, name) for sample in judged]) for name in LIMITS}

    @property
    def long_enough(self) -> bool:
        """Whether the rises can be judged."""
        return len(self.samples) * (_WARM_UP - 1) // _WARM_UP >= 2 * len(ATTACKS)


def rise(values: Sequence[float]) -> float:
    """Return the rise of the least-squares line through equally spaced values, as a share of their mean."""
    middle, mean = (len(values) - 1) / 2, statistics.fmean(values)
    spread = sum((place - middle) ** 2 for place in range(len(values)))
    slope = sum((place - middle) * (value - mean) for place, value in enumerate(values)) / spread if spread else 0.0
    return slope * (len(values) - 1) / mean if mean else 0.0


async def soak(seconds: float, clients: int, every_s: float, idle_timeout_s: float, console: Console) -> Soaked:
    """Load a host for some wall time and take samples."""
    seen = Soaked()
    with hosted("--idle-timeout", str(idle_timeout_s)) as host:
        await _episodes(host)  # makes the host open its permanent files first
        files, began = host.open_files, time.monotonic()
        crowd = Crowd(host.port, clients, _CALLS_EACH)
        playing = asyncio.ensure_future(crowd.play())
        for kind in itertools.cycle(ATTACKS):
            if time.monotonic() - began >= seconds or playing.done():
                break
            crowd.take()
            async with attacking(host.port, kind) as counts:
                await asyncio.sleep(every_s)
                sample = await _sample(host, crowd, time.monotonic() - began)
            if not counts:
                seen.problems.append(f"the attacker died: {kind}")
            seen.samples.append(sample)
            seen.attacks.append(kind)
            console.print(*_cells(sample), kind, sep="\t")
        playing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await playing
        seen.problems += [f"an honest call failed: {failure}" for failure in crowd.failures]
        seen.problems += await _left_open(host, files, idle_timeout_s)
        seen.problems += host.errors()
    return seen


async def _sample(host: Hosted, crowd: Crowd, time_s: float) -> Sample:
    took_ms = [1000 * took for took in crowd.take()] or [0.0]
    state = (host.memory_mb, host.open_files, host.threads, await _episodes(host), len(took_ms))
    return Sample(time_s, *state, statistics.median(took_ms), max(took_ms))


async def _episodes(host: Hosted) -> int:
    connection = await Connection.dial(host.port)
    try:
        return json.loads((await connection.ask(request("GET", "/healthz"))).body)["episodes"]
    finally:
        connection.close()


async def _left_open(host: Hosted, files: int, idle_timeout_s: float) -> list[str]:
    """Sentences about resources that the host has not closed after the clients have left.

    Args:
        host: The host.
        files: Number of files that the host had open at the start.
        idle_timeout_s: Idle timeout of an episode [s].
    """
    until = time.monotonic() + idle_timeout_s + _PATIENCE_S
    # The connection of the check itself may still be closing.
    while (episodes := await _episodes(host)) or host.open_files > files + 1:
        if time.monotonic() > until:
            return [f"{episodes} episodes and {host.open_files - files} more files than at the start are still open"]
        await asyncio.sleep(0.2)
    return []


def _cells(sample: Sample) -> list[str]:
    return [f"{getattr(sample, column.name):.4g}" for column in fields(Sample)]


def report(seen: Soaked, console: Console) -> bool:
    """Print the rises and the problems; returns whether there are no problems."""
    table = Table(title="Rise after the warm-up, as a share of the mean", box=None)
    for title in ("quantity", "rise", "at most"):
        table.add_column(title, justify="left" if title == "quantity" else "right")
    rises = seen.rises()
    for name, most in LIMITS.items():
        table.add_row(name, f"{rises[name]:+.1%}", f"{most:.0%}" + ("  above" if rises[name] > most else ""))
    console.print(table)
    if not seen.long_enough:
        console.print(f"too short to be judged: {len(seen.samples)} samples of {len(ATTACKS)} attacks")
    for problem in seen.problems[:20]:
        console.print(problem, style="red", highlight=False, markup=False)
    flat = not seen.long_enough or all(rises[name] <= most for name, most in LIMITS.items())
    return flat and not seen.problems


def main(argv: Sequence[str]) -> int:
    """Load a host and print a table; returns 1 if something grew, failed or was not closed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="wall time (30)")
    parser.add_argument("--clients", type=int, default=50, help="honest clients (50)")
    parser.add_argument("--every", type=float, default=10.0, help="wall time of an attack and of a sample [s] (10)")
    parser.add_argument("--idle-timeout", type=float, default=30.0, help="how long an unused episode lives [s] (30)")
    args = parser.parse_args(argv)
    console = Console(width=150, highlight=False)
    console.print(*(column.name for column in fields(Sample)), "attack", sep="\t")
    seen = asyncio.run(soak(60 * args.minutes, args.clients, args.every, args.idle_timeout, console))
    return 0 if report(seen, console) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
