"""A host of several processes: starts the workers, starts again those that are lost, and ends them with the front."""

import contextlib
import json
import logging
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from dataclasses import dataclass, field

import anyio
from anyio.abc import Process, TaskStatus

from physment_mcp.errors import UsageError
from physment_mcp.serving.front import Front
from physment_mcp.serving.host_worker import WorkerOptions
from physment_mcp.serving.listening import announce
from physment_mcp.serving.places import shared_memory

logger = logging.getLogger(__name__)

_AGAIN_S = 1.0
"""Pause before a worker that was lost is started again [s]."""


@dataclass(slots=True)
class _Crew:
    """What the front keeps of its workers."""

    options: Callable[[int, int, int], WorkerOptions]
    memory: "memoryview[int]"
    file: int
    sockets: list[tuple[socket.socket, socket.socket]] = field(
        default_factory=list[tuple[socket.socket, socket.socket]]
    )
    """For each worker, our end and its own. Ours keeps both, so a connection waits while a worker is started again."""

    async def keep(self, number: int, *, task_status: TaskStatus[None]) -> None:
        """Run a worker, and start it again whenever it is lost.

        Raises:
            UsageError: It does not start the first time.
        """
        started = False
        while True:
            async with self._process(number) as process:
                if await _is_ready(process):
                    if not started:
                        started = True
                        task_status.started()
                    await process.wait()
                elif not started:
                    raise UsageError(f"worker {number + 1} of {len(self.sockets)} does not start")
            self.memory[number] = 0
            logger.warning("worker %d was lost, with its episodes, and is started again", number + 1)
            await anyio.sleep(_AGAIN_S)

    @contextlib.asynccontextmanager
    async def _process(self, number: int) -> AsyncGenerator[Process]:
        theirs = self.sockets[number][1].fileno()
        told = self.options(number, theirs, self.file)
        process = await anyio.open_process(
            [sys.executable, "-m", "physment_mcp.serving.host_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=None,
            pass_fds=[theirs, self.file],
            start_new_session=True,  # Ctrl-C on a terminal goes to the front alone
        )
        try:
            assert process.stdin is not None
            with contextlib.suppress(anyio.BrokenResourceError):
                await process.stdin.send(json.dumps(told).encode() + b"\n")
            yield process
        finally:
            with anyio.CancelScope(shield=True), contextlib.suppress(ProcessLookupError):
                process.terminate()
                await process.aclose()


async def _is_ready(process: Process) -> bool:
    """Wait until a worker serves; returns False if it ends before."""
    assert process.stdout is not None
    try:
        return bool(await process.stdout.receive())
    except anyio.EndOfStream:
        return False


async def serve_with_workers(
    listener: socket.socket, count: int, options: Callable[[int, int, int], WorkerOptions]
) -> None:
    """Serve until interrupted. Prints the address once all workers serve.

    Args:
        listener: Where connections come in.
        count: How many workers.
        options: What a worker is told: its number, and the descriptors of its socket and of the file of places.

    Raises:
        UsageError: A worker does not start.
    """
    with contextlib.ExitStack() as open_files:
        try:
            file = open_files.enter_context(tempfile.TemporaryFile())
            file.truncate(8 * count)
            crew = _Crew(options, shared_memory(file.fileno(), count), file.fileno())
            for _ in range(count):
                crew.sockets.append(pair := socket.socketpair())
                open_files.enter_context(pair[0])
                open_files.enter_context(pair[1])
            with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
                async with anyio.create_task_group() as tasks:
                    tasks.start_soon(_end_at_signal, signals, tasks.cancel_scope)
                    for number in range(count):
                        await tasks.start(crew.keep, number)
                    front = Front(listener, [ours for ours, _ in crew.sockets])
                    announce(listener)
                    await front.run()
        except* UsageError as problems:
            raise UsageError(str(_first(problems))) from None
        except* OSError as problems:
            raise UsageError(f"--workers {count}: they cannot start: {_first(problems)}") from None


async def _end_at_signal(signals: AsyncIterator[signal.Signals], scope: anyio.CancelScope) -> None:
    async for _ in signals:
        scope.cancel()


def _first(error: BaseException) -> BaseException:
    """The first error inside exception groups that is not itself a group."""
    return _first(error.exceptions[0]) if isinstance(error, BaseExceptionGroup) else error  # pyright: ignore[reportUnknownMemberType, reportUnknownArgumentType] - of what, a group does not say
