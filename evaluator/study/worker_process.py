"""The process of a worker that `--workers` starts: plays what it is asked to, and ends when nobody asks any more."""

import gc
import socket
import sys
import traceback
from typing import Any

import anyio

from evaluator.study.channel import Crash, ProcessChannel
from evaluator.study.workers import EpisodeWorker


async def serve(connection: socket.socket) -> None:
    """Play until the run says that it is over, or is gone itself."""
    channel = await ProcessChannel.over(connection)
    worker: EpisodeWorker | None = None
    last: int | None = None
    """Number of the request that ends this process."""

    async def answer(number: int, what: str, arguments: tuple[Any, ...]) -> None:
        try:
            outcome = await getattr(worker, what)(*arguments)
        except Exception:  # noqa: BLE001 - the run must see it, and not only that this process has ended
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
    # As in the process of the run, whose limit of open files this one has inherited.
    gc.set_threshold(10_000, 20, 20)
    anyio.run(serve, socket.socket(fileno=int(sys.argv[1])))
