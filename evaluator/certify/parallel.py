"""Runs jobs in parallel worker processes, and delivers each result when it is ready."""

import os
from collections.abc import Callable, Iterable
from typing import TypeVar

import anyio.to_process

J = TypeVar("J")
R = TypeVar("R")


async def in_processes(
    jobs: Iterable[J], work: Callable[[J], Callable[[], R]], workers: int, on_done: Callable[[J, R], None]
) -> None:
    """Run a function for each job.

    Args:
        jobs: The jobs.
        work: Function that returns, for a job, the function to run in a worker process. The latter must be picklable.
        workers: Number of processes.
        on_done: Called in this process with each job and its result, in order of completion.
    """
    # Inherited by the processes. The matrices are small, so a second OpenBLAS thread would only busy-wait.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    limiter = anyio.CapacityLimiter(workers)

    async def one(job: J) -> None:
        on_done(job, await anyio.to_process.run_sync(work(job), cancellable=True, limiter=limiter))

    async with anyio.create_task_group() as tasks:
        for job in jobs:
            tasks.start_soon(one, job)
