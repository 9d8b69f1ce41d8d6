"""Fault injection: disturbs runs of the evaluator at a random moment and then resumes them.

Afterwards, every episode must be recorded once, with the same grade as in an undisturbed run; no process may be left
behind; and the run must have said in one sentence why it ended. Prints a table of faults and outcomes. Keeps the
folders of runs that failed.

python -m tests.harness.load.faults [--count N] [--seed N] [--seeds N] [--kinds WORD,…]
"""

import argparse
import ctypes
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.harness.load import disks
from tests.harness.load.evaluation import Broken, Evaluation

_STDIO_EVERY = 6
"""Interval of runs that play on stdio, with a process per episode, which takes five times as long."""
_DROP_CAPABILITY, _IGNORE_PERMISSIONS = 24, 1  # PR_CAPBSET_DROP, CAP_DAC_OVERRIDE


@dataclass(frozen=True)
class Undisturbed:
    """The reference run without a fault."""

    results: dict[str, object]
    took_s: float
    size: int
    """Size of its `episodes.jsonl` [bytes]."""


@dataclass
class Struck:
    """A run, and the moment at which the fault strikes."""

    evaluation: Evaluation
    usual: Undisturbed
    chance: random.Random

    def strike(
        self, fault: Callable[[subprocess.Popen[str]], None], prepare: Callable[[], None] | None = None
    ) -> tuple[int, str]:
        """Start the run, inject the fault at a random moment, wait for the end; returns exit code and stderr."""
        with self.evaluation.started(prepare) as process:
            time.sleep(self.chance.uniform(0, self.usual.took_s))
            fault(process)
            return self.evaluation.wait_for(process)

    @property
    def records(self) -> Path:
        """Path of the run's `episodes.jsonl`."""
        return self.evaluation.folder / "episodes.jsonl"


Fault = Callable[[Struck], int]
"""Injects a fault into a run; returns the exit code of the run's process."""


def _signalled(sign: signal.Signals) -> Fault:
    return lambda run: run.strike(lambda process: process.send_signal(sign))[0]


def _signalled_in_background(run: Struck) -> int:
    run.evaluation.background = True
    return _signalled(signal.SIGTERM)(run)


def _server_killed(run: Struck) -> int:
    def kill(process: subprocess.Popen[str]) -> None:
        servers = [number for number in run.evaluation.processes() if number != process.pid]
        if servers:
            try:
                os.kill(run.chance.choice(servers), signal.SIGKILL)
            except ProcessLookupError:  # it has just ended
                return

    return run.strike(kill)[0]


def _worker_killed(run: Struck) -> int:
    run.evaluation.workers = 2
    return _server_killed(run)


def _full_disk(run: Struck) -> int:
    most = run.chance.randrange(run.usual.size)
    return run.strike(
        lambda _process: None, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    )[0]


def _torn_line(run: Struck) -> int:
    code = _signalled(signal.SIGKILL)(run)
    if run.records.exists() and (lines := run.records.read_bytes().splitlines(keepends=True)):
        with run.records.open("r+b") as stream:
            # One byte stays: a sealed line that is missing as a whole counts as an edit, and the run is refused.
            stream.truncate(run.records.stat().st_size - run.chance.randrange(1, len(lines[-1])))
    return code


def _garbage_line(run: Struck) -> int:
    code = _signalled(signal.SIGKILL)(run)
    lines = run.records.read_bytes().splitlines(keepends=True) if run.records.exists() else []
    garbage = run.chance.choice([b"\n", b"{}\n", b"\0" * 4096 + b"\n", b"\xff\xfe garbage\n", b'{"format": 1, "key"\n'])
    lines.insert(run.chance.randint(0, len(lines)), garbage)
    if run.evaluation.folder.is_dir():
        run.records.write_bytes(b"".join(lines))
    return code


def _read_only(run: Struck) -> int:
    folder = run.evaluation.folder
    folder.mkdir()

    def lock(_process: subprocess.Popen[str]) -> None:
        for file in folder.iterdir():
            file.chmod(0o444)
        folder.chmod(0o555)

    # The superuser can write despite these permissions, unless the process drops that capability.
    libc = ctypes.CDLL(None)
    code, _ = run.strike(lock, lambda: libc.prctl(_DROP_CAPABILITY, _IGNORE_PERMISSIONS, 0, 0, 0))
    folder.chmod(0o755)
    for file in folder.iterdir():
        file.chmod(0o644)
    return code


def _on_own_disk(strike: Callable[[Struck], int]) -> Fault:
    """Play and resume on a separate file system, then copy the run from it."""

    def fault(run: Struck) -> int:
        folder = run.evaluation.folder
        kept = folder.with_name(f"{folder.name}-kept")
        folder.mkdir()
        with disks.mounted(folder):
            code = strike(run)
            run.evaluation.complete()
            shutil.copytree(folder, kept)
        folder.rmdir()
        kept.rename(folder)
        return code

    return fault


def _no_space(run: Struck) -> int:
    folder = run.evaluation.folder
    disks.fill(folder, run.chance.randrange(run.usual.size))
    code, _ = run.strike(lambda _process: None)
    if code == 0:
        raise Broken("there was no space for all episodes, and the run says that all is well")
    disks.empty(folder)
    return code


def _turned_read_only(run: Struck) -> int:
    folder = run.evaluation.folder

    def lock(process: subprocess.Popen[str]) -> None:
        while process.poll() is None and not disks.turn(folder, "ro"):
            pass

    code, _ = run.strike(lock)
    if not disks.turn(folder, "rw"):
        raise Broken("a file is still open for writing")
    return code


FAULTS: dict[str, Fault] = {
    "SIGINT": _signalled(signal.SIGINT),
    "SIGTERM": _signalled(signal.SIGTERM),
    "SIGTERM in the background": _signalled_in_background,
    "SIGHUP": _signalled(signal.SIGHUP),
    "SIGKILL": _signalled(signal.SIGKILL),
    "server killed": _server_killed,
    "worker killed": _worker_killed,
    "full disk": _full_disk,
    "torn last line": _torn_line,
    "garbage line": _garbage_line,
    "read-only folder": _read_only,
    "full file system": _on_own_disk(_no_space),
    "file system turned read-only": _on_own_disk(_turned_read_only),
}
"""Kind → the fault."""
NEED_MOUNTS = {kind for kind in FAULTS if "file system" in kind}
"""Kinds of faults that need permission to mount a file system."""


def undisturbed(folder: Path, server: str, seeds: int) -> Undisturbed:
    """Play without a fault."""
    run, began = Evaluation(folder, server, seeds), time.monotonic()
    run.complete()
    return Undisturbed(run.results(), time.monotonic() - began, (folder / "episodes.jsonl").stat().st_size)


def disturb(kind: str, folder: Path, server: str, usual: Undisturbed, seeds: int, chance: random.Random) -> str:
    """Play, inject a fault, and resume; returns how the disturbed process ended.

    Raises:
        Broken: An invariant does not hold afterwards.
    """
    run = Evaluation(folder, server, seeds)
    code = FAULTS[kind](Struck(run, usual, chance))
    run.complete()
    if run.results() != usual.results:
        raise Broken("answers or grades differ from those of an undisturbed run")
    return f"exit {code}" if code >= 0 else signal.Signals(-code).name


def main(argv: Sequence[str]) -> int:
    """Disturb runs and print a table; returns 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="faults (200)")
    parser.add_argument("--seed", type=int, default=None, help="of the moments and kinds (default: a new one)")
    parser.add_argument("--seeds", type=int, default=8, help="seeds of each of the 6 scenes (8)")
    parser.add_argument("--kinds", default="", help=f"words in the names of: {' · '.join(FAULTS)}")
    args = parser.parse_args(argv)
    kinds = [kind for kind in FAULTS if any(word in kind for word in args.kinds.split(","))]
    left_out = NEED_MOUNTS.intersection(kinds) if not disks.may_mount() else set[str]()
    kinds = [kind for kind in kinds if kind not in left_out]
    seed = random.SystemRandom().randrange(10**6) if args.seed is None else args.seed
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print(f"seed {seed}")
    for kind in sorted(left_out):
        console.print(f"left out, because this process may not mount file systems: {kind}")
    scratch = Path(tempfile.mkdtemp(prefix="physment-faults-"))
    usual: dict[str, Undisturbed] = {}
    outcomes: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for number in range(args.count):
        kind, chance = kinds[number % len(kinds)], random.Random(f"{seed}/{number}")
        server = "stdio" if chance.randrange(_STDIO_EVERY) == 0 else "host"
        folder = scratch / f"{number:03}"
        if server not in usual:
            usual[server] = undisturbed(scratch / f"undisturbed-{server}", server, args.seeds)
        try:
            outcome = disturb(kind, folder, server, usual[server], args.seeds, chance)
            shutil.rmtree(folder)
        except Broken as broken:
            outcome = "FAILED"
            console.print(f"{kind}, {server}, {folder}: {broken}")
        console.print(f"{number + 1}/{args.count}: {kind}, {server}: {outcome}")
        outcomes[f"{kind}, {server}"][outcome] += 1
    return _report(console, outcomes, scratch)


def _report(console: Console, outcomes: dict[str, Counter[str]], scratch: Path) -> int:
    table = Table(title="Faults, and how the disturbed process ended", box=None)
    table.add_column("fault")
    table.add_column("outcomes")
    for name, counts in sorted(outcomes.items()):
        table.add_row(name, ", ".join(f"{outcome} × {count}" for outcome, count in sorted(counts.items())))
    console.print(table)
    failed = sum(counts["FAILED"] for counts in outcomes.values())
    every = sum(counts.total() for counts in outcomes.values())
    console.print(f"{every - failed} of {every} runs were completed as if nothing had happened")
    if not failed:
        shutil.rmtree(scratch)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
