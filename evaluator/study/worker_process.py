"""The worker process that `--workers` starts, and the channel between it and the process of the run.

The worker process ends when the other end of the channel is closed.
"""

import asyncio
import contextlib
import gc
import pickle
import socket
import sys
import traceback
from dataclasses import dataclass
from typing import Any, Self

import anyio

from evaluator.study.workers import Crash, EpisodeWorker

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


if __name__ == "__main__":
    # GC thresholds for a process with many long-lived objects. The limit of open files is inherited from the parent.
    gc.set_threshold(10_000, 20, 20)
    anyio.run(serve, socket.socket(fileno=int(sys.argv[1])))
