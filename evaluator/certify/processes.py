"""Worker processes: for jobs that run in parallel, and for functions that render off-screen.

A missing or broken graphics library may crash the process that loads it, and MuJoCo selects the library only once, when
it is imported. Therefore this process never renders.
"""

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

import anyio.to_process

J = TypeVar("J")
R = TypeVar("R")

RENDERER = "MUJOCO_GL"
"""Environment variable with which MuJoCo selects its graphics library."""
_OFF_SCREEN = ("osmesa", "egl")
"""Libraries that render off-screen. `osmesa` needs no graphics card and renders equally on every machine."""


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


class NoRenderer(Exception):
    """No library on this machine renders off-screen; the message is one sentence."""


@contextlib.contextmanager
def renderers(count: int) -> Generator[ProcessPoolExecutor]:
    """Start processes that can render, and end them after the block.

    Each process selects an OpenGL library (`MUJOCO_GL`) when it starts. Functions that run in it must therefore import
    the drawing code in their body: an import at the top of a module would load it before the selection.

    Args:
        count: Number of processes.

    Raises:
        NoRenderer: No library on this machine renders off-screen.
    """
    chosen = os.environ.get(RENDERER)
    tried = (chosen,) if chosen else _OFF_SCREEN
    for renderer in tried:
        pool = ProcessPoolExecutor(
            count, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare, initargs=(renderer,)
        )
        with pool:
            if _is_able(pool):
                yield pool
                return
    raise NoRenderer(
        f"no pictures: nothing draws off-screen here ({RENDERER} as {' or '.join(tried)}); install libosmesa6"
    )


def _is_able(pool: ProcessPoolExecutor) -> bool:
    try:
        return pool.submit(_draws).result()
    except BrokenProcessPool:
        return False


def _prepare(renderer: str) -> None:
    """Select the graphics library before MuJoCo is imported, and discard the output of a broken one."""
    os.environ[RENDERER] = renderer
    sys.stdout.flush()
    sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)


def _draws() -> bool:
    try:
        from evaluator.certify.pictures import check_renderer  # noqa: PLC0415 - after MUJOCO_GL is set, only in a worker process

        check_renderer()
    except Exception:  # noqa: BLE001 - each library raises different errors
        return False
    return True
