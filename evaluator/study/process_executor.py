"""`--workers N`: worker processes on this machine play the episodes. With `--server host` each starts its own host.

A worker runs this module and holds one end of a socket pair. A number matches each reply on the socket to its request.
Each side detects the end of the other as end of file. A worker then stops its servers and exits.
"""

import asyncio
import contextlib
import gc
import itertools
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import traceback
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Self

import anyio.to_thread
from anyio.abc import TaskGroup

from evaluator.episode.loop import Participant
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Versions
from evaluator.records.run import RunRecord
from evaluator.study.run_config import EXTERNAL, RunConfig
from evaluator.study.runner import Play
from evaluator.study.workers import (
    VERSION,
    Crash,
    EpisodeWorker,
    Terms,
    WorkerLost,
    Workers,
    WorkerSlot,
    lanes_of,
    shares,
)

_LENGTH = 8
"""Size of the length prefix of a message [bytes]."""


@dataclass(slots=True)
class ProcessChannel:
    """Sends pickled objects over a socket between two processes of one run, which trust each other."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    closed: bool = False
    """Whether the other end has closed the connection."""

    @classmethod
    async def over(cls, connection: socket.socket) -> Self:
        """Create a channel over a connected socket."""
        return cls(*await asyncio.open_connection(sock=connection))

    async def receive(self) -> Any:
        """Receive the next object; None if the other end has closed the connection."""
        try:
            length = int.from_bytes(await self.reader.readexactly(_LENGTH))
            return pickle.loads(await self.reader.readexactly(length))  # noqa: S301 - from our own process
        except (asyncio.IncompleteReadError, OSError):
            self.closed = True
            return None

    def send(self, message: object) -> None:
        """Send an object. Does nothing if the other end has closed the connection."""
        written = pickle.dumps(message)
        with contextlib.suppress(OSError):
            self.writer.write(len(written).to_bytes(_LENGTH) + written)

    def close(self) -> None:
        """Close the connection."""
        self.closed = True
        self.writer.close()


async def serve(connection: socket.socket) -> None:
    """Serve requests until the parent sends `close` or closes the connection."""
    channel = await ProcessChannel.over(connection)
    worker: EpisodeWorker | None = None
    last: int | None = None
    """Number of the request that ends this process."""

    async def answer(number: int, what: str, arguments: tuple[Any, ...]) -> None:
        try:
            outcome = await getattr(worker, what)(*arguments)
        except Exception:  # noqa: BLE001 - the run must receive the traceback, not only learn that this process ended
            outcome = Crash(traceback.format_exc())
        channel.send((number, outcome))

    try:
        async with anyio.create_task_group() as tasks:
            while last is None and (message := await channel.receive()) is not None:
                number, what, arguments = message
                if what == "close":
                    last = number
                elif what == "prepare":
                    (worker,) = arguments
                    tasks.start_soon(answer, number, what, ())
                else:
                    tasks.start_soon(answer, number, what, arguments)
            tasks.cancel_scope.cancel()
    finally:
        if worker is not None:
            with anyio.CancelScope(shield=True):
                await worker.close()
    if last is not None:
        channel.send((last, None))
    channel.close()


AVAILABLE = hasattr(socket, "AF_UNIX")
"""Whether the platform has the Unix domain sockets that workers need; Windows has none."""
_KIND = "worker process"
_PATIENCE_S = 60.0
"""Longest time for a lost worker to restart [s]. A restart usually takes a few seconds."""
_MEMORY = 400 * 2**20
"""Memory of a worker and its host with about a hundred open episodes [bytes]."""
_EPISODES_EACH = 25
"""Fewest episodes per worker by default, because starting a worker costs 3 s of processor time."""
_CONCURRENT_EACH = 4
"""Fewest concurrent episodes per worker by default, for the same reason."""
_END_S = 5.0
"""Longest wall time for a worker to end by itself [s]."""


def usual_workers(config: RunConfig, episodes: int) -> int:
    """Default number of workers, limited by the number of episodes, the processors and the free memory.

    Args:
        config: The configuration of the run.
        episodes: Number of episodes to play.
    """
    if not AVAILABLE or EXTERNAL in config.agents or config.server == "stdio":
        return 1  # external programs and stdio servers run in processes of their own
    worth = min(episodes // _EPISODES_EACH, config.concurrency // _CONCURRENT_EACH)
    return max(1, min(_processors(), _free_memory() // _MEMORY, worth))


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # processors that the scheduler assigned; not on macOS
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _free_memory() -> int:
    """Free memory [bytes]; where the platform does not report it, a value too large to limit the workers."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return sys.maxsize


@dataclass(slots=True, eq=False)
class _ProcessWorker:
    """A `Worker` in a child process, which is restarted if it is lost."""

    plan: EpisodeWorker
    """The worker object that is sent to the process."""
    tasks: TaskGroup
    """Task group of the task that reads the replies."""
    _process: subprocess.Popen[bytes] | None = None
    _channel: ProcessChannel | None = None
    _errors: IO[str] | None = None
    _numbers: "itertools.count[int]" = field(default_factory=itertools.count)
    _waiting: dict[int, "_Reply"] = field(default_factory=dict[int, "_Reply"])

    async def prepare(self) -> UsageError | None:
        """Restart the process and prepare its worker; see `Worker.prepare`."""
        await self.stop()
        try:
            await self._start()
        except OSError as error:
            return UsageError(f"a {_KIND} cannot start: {error.strerror or error}")
        try:
            return await self._ask("prepare", self.plan)
        except WorkerLost:
            if await anyio.to_thread.run_sync(self._ended) > 0:
                return UsageError(f"a {_KIND} cannot start: {self._last_line()}")
            raise

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """Play one episode in the process; see `Worker.play`."""
        return await self._ask("play", key, versions, timeout_s)

    async def close(self) -> None:
        """Close the servers that the process started; see `Worker.close`."""
        await self._ask("close")

    async def stop(self) -> None:
        """End the process, if there is one."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            await anyio.to_thread.run_sync(self._ended)
            self._process = None
        if self._errors is not None:
            self._errors.close()
            self._errors = None

    def _ended(self) -> int:
        """Wait for the process to end, kill it after a timeout, and return its exit code."""
        assert self._process is not None
        try:
            return self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    async def _start(self) -> None:
        """Start the process.

        Raises:
            OSError: The limit of processes or open files is reached.
        """
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed in stop
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                self._process = subprocess.Popen(  # noqa: ASYNC220, S603 - our own program, and does not wait
                    [sys.executable, "-m", "evaluator.study.process_executor", str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    stderr=self._errors,
                    pass_fds=[theirs.fileno()],
                    # A new session, so that Ctrl-C on a terminal reaches the parent only, which then ends its workers.
                    start_new_session=True,
                )
            self._channel = await ProcessChannel.over(ours)
        except BaseException:
            ours.close()
            raise
        self.tasks.start_soon(self._read, self._channel)

    async def _read(self, channel: ProcessChannel) -> None:
        """Deliver each reply to its waiting request, until the process ends."""
        while (message := await channel.receive()) is not None:
            number, outcome = message
            self._waiting.pop(number).set(outcome)
        for waiting in self._waiting.values():
            waiting.set(WorkerLost())
        self._waiting.clear()

    async def _ask(self, what: str, *arguments: object) -> Any:
        if self._channel is None or self._channel.closed:
            raise WorkerLost
        number = next(self._numbers)
        reply = self._waiting[number] = _Reply()
        self._channel.send((number, what, arguments))
        await reply.there.wait()
        match reply.outcome:
            case WorkerLost():
                raise reply.outcome
            case Crash(trace):
                # A bug in this package or in an agent: a retry would fail in the same way.
                raise RuntimeError(trace)
            case outcome:
                return outcome

    def _last_line(self) -> str:
        assert self._errors is not None
        self._errors.seek(0)
        lines = [line.strip() for line in self._errors.read().splitlines() if line.strip()]
        return lines[-1] if lines else "it says nothing"


@dataclass(slots=True)
class _Reply:
    """The pending reply of one request."""

    there: anyio.Event = field(default_factory=anyio.Event)
    outcome: Any = None

    def set(self, outcome: Any) -> None:
        self.outcome = outcome
        self.there.set()


@contextlib.asynccontextmanager
async def process_workers(
    config: RunConfig,
    participants: Mapping[str, Participant],
    record: RunRecord,
    *,
    count: int,
    patience_s: float = _PATIENCE_S,
) -> AsyncGenerator[Play]:
    """Start workers on this machine and yield the function that plays an episode on one of them.

    Args:
        config: The configuration of the run.
        participants: The participants of `config`. Their settings contain the concurrency limits of the providers,
            which are divided among the workers.
        record: The record of the run.
        count: Number of workers. Fewer are started if fewer episodes are played at a time, or if a provider allows
            fewer concurrent requests.
        patience_s: Longest time for a lost worker to restart [s].

    Raises:
        UsageError: A worker cannot start.
    """
    lanes = lanes_of(config, participants)
    count = max(1, min(count, config.concurrency, *lanes.values()))
    shared = replace(config, lanes={provider: max(1, limit // count) for provider, limit in lanes.items()})
    packs = record.packs if config.server in {"stdio", "host"} else {}
    plan = EpisodeWorker(shared, Path.cwd(), VERSION, packs, _KIND)
    async with anyio.create_task_group() as tasks:
        workers = [_ProcessWorker(plan, tasks) for _ in range(count)]
        slots = [
            WorkerSlot(worker, places)
            for worker, places in zip(workers, shares(config.concurrency, count), strict=True)
        ]
        try:
            async with Workers(slots, Terms(record, config.episode_timeout_s, patience_s, _KIND)).at_work() as play:
                yield play
        finally:
            tasks.cancel_scope.cancel()
            with anyio.CancelScope(shield=True):
                async with anyio.create_task_group() as ending:
                    for worker in workers:
                        ending.start_soon(worker.stop)


if __name__ == "__main__":
    # GC thresholds for a process with many long-lived objects. The limit of open files is inherited from the parent.
    gc.set_threshold(10_000, 20, 20)
    anyio.run(serve, socket.socket(fileno=int(sys.argv[1])))
