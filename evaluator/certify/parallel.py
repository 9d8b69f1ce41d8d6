"""Runs jobs in parallel worker processes, and hands over each result as soon as it is there."""

import os
from collections.abc import Callable, Iterable
from typing import TypeVar

import anyio
from anyio import to_process

J = TypeVar("J")
R = TypeVar("R")


async def in_processes(
    jobs: Iterable[J], work: Callable[[J], Callable[[], R]], workers: int, on_done: Callable[[J, R], None]
) -> None:
    """Run a job for each of some things.

    Args:
        jobs: The things.
        work: What is run for a thing in a worker process; it can be pickled.
        workers: Number of processes.
        on_done: Called in this process with each thing and its result, in the order in which they end.
    """
    # Inherited by the processes. The matrices are small: a second thread of OpenBLAS would only spin beside the first.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    limiter = anyio.CapacityLimiter(workers)

    async def one(job: J) -> None:
        on_done(job, await to_process.run_sync(work(job), cancellable=True, limiter=limiter))

    async with anyio.create_task_group() as tasks:
        for job in jobs:
            tasks.start_soon(one, job)
