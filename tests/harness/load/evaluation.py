"""A run of the evaluator in a child process for fault injection, and the invariants of its run folder. Linux only."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evaluator.errors import StoreError
from evaluator.records.episode import Outcome
from evaluator.store.run_folder import RunFolder

SCENES = range(7, 13)
"""Easy scenes, which the reference agent solves within a second."""
_MARK = "PHYSMENT_FAULT_RUN"
"""Environment variable by which the processes of a run are recognised."""
_LONGEST_S = 300.0
"""Time limit after which a run counts as hanging [s]."""
_LAST_S = 15.0
"""Time for the child processes of a run to end after it [s]."""
_TRIES = 4
"""Number of starts after which a disturbed run must be complete."""
_HEEDING = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL); from evaluator.__main__ import entry; entry()"
"""Code that restores Ctrl-C and starts the program. Until then the process ignores Ctrl-C, because Python would print a
traceback if it came while Python initialises."""
_NOTE = re.compile(r"physment-eval: .*, line \d+ was damaged ")


class Broken(Exception):
    """An invariant does not hold after a fault."""


@dataclass
class Evaluation:
    """A run of the reference agent."""

    folder: Path
    server: str
    seeds: int
    workers: int = 1
    """Number of worker processes."""
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)
    starts: int = 0
    background: bool = False
    """Whether SIGINT is ignored, as in a background job of a script."""

    @property
    def episodes(self) -> int:
        """Number of episodes of the run."""
        return len(SCENES) * self.seeds

    @contextlib.contextmanager
    def started(self, prepare: Callable[[], None] | None = None) -> Generator[subprocess.Popen[str]]:
        """Start or resume the run.

        Args:
            prepare: Function that runs in the new process before the evaluator does.
        """
        words = ["--server", self.server, "--scenes", f"{SCENES[0]}-{SCENES[-1]}", "--seeds", f"0-{self.seeds - 1}"]
        words += ["--workers", str(self.workers), "--concurrency", "4", "--out", str(self.folder), "--resume"]

        def begin() -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            if prepare is not None:
                prepare()

        with subprocess.Popen(
            [sys.executable, *(("-m", "evaluator") if self.background else ("-c", _HEEDING)), *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {_MARK: self.mark},
            preexec_fn=begin,  # noqa: PLW1509 - this process has one thread
        ) as process:
            self.starts += 1
            try:
                yield process
            finally:
                process.kill()

    def wait_for(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        """Wait for the run and all its child processes to end; returns the exit code and stderr.

        Raises:
            Broken: The run hangs, leaves a process behind, or does not say in one sentence why it ended.
        """
        try:
            _, errors = process.communicate(timeout=_LONGEST_S)
        except subprocess.TimeoutExpired:
            raise Broken(f"the run did not end within {_LONGEST_S:g} s") from None
        until = time.monotonic() + _LAST_S
        while left := self.processes():
            if time.monotonic() > until:
                for number in left:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(number, signal.SIGKILL)
                raise Broken(f"processes were left behind: {left}")
            time.sleep(0.02)
        lines = [line for line in errors.splitlines() if not _NOTE.match(line)]
        if any(not line.startswith("physment-eval: ") for line in lines):
            raise Broken(f"stderr is no sentence of ours: {errors[-2000:]}")
        if process.returncode > 0 and len(lines) != 1:
            raise Broken(f"exit code {process.returncode} with {len(lines)} sentences: {errors}")
        return process.returncode, errors

    def processes(self) -> list[int]:
        """Ids of all living processes of the run."""
        found: list[int] = []
        for process in Path("/proc").glob("[0-9]*"):
            # The process ended meanwhile or belongs to another user. An ended process has no environment.
            with contextlib.suppress(OSError):
                if f"{_MARK}={self.mark}\0".encode() in (process / "environ").read_bytes():
                    found.append(int(process.name))
        return sorted(found)

    def complete(self) -> None:
        """Resume the run until it is complete.

        Raises:
            Broken: The run is not complete after all attempts.
        """
        said = ""
        for _ in range(_TRIES):
            with self.started() as process:
                code, said = self.wait_for(process)
            if code == 0:
                return
        raise Broken(f"it is not complete after {self.starts} starts: {said}")

    def results(self) -> dict[str, Any]:
        """Return episode → its answer and its verdicts, of a complete run.

        Raises:
            Broken: A record is missing, unreadable or duplicated.
        """
        folder = RunFolder(self.folder)
        try:
            folder.read_run()
            grades, last = folder.grades(), folder.episodes()
            # An episode with an infrastructure error is recorded, and played again when the run is resumed.
            lines = folder.episodes_file.read_bytes().split(b"\n")[:-1]
        except (StoreError, OSError) as error:
            raise Broken(f"the folder cannot be read: {error}") from error
        failed = f'"outcome":"{Outcome.INFRASTRUCTURE_ERROR}"'.encode()
        played = sum(failed not in line for line in lines)
        if not played == len(last) == len(grades) == self.episodes:
            raise Broken(f"{played} records of {len(last)} episodes with {len(grades)} grades; wanted {self.episodes}")
        return {
            str(key): (episode.answer, grades[key].grade.strict, grades[key].grade.graded, grades[key].grade.normalised)
            for key, episode in last.items()
        }
