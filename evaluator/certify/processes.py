"""Worker processes: for jobs that run in parallel, and for functions that render off-screen.

A missing or broken graphics library may crash the process that loads it, and MuJoCo selects the library only once, when
it is imported. Therefore this process never renders.
"""

import asyncio
import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

import anyio

from evaluator.errors import InfrastructureError

J = TypeVar("J")
R = TypeVar("R")

RENDERER = "MUJOCO_GL"
"""Environment variable with which MuJoCo selects its graphics library."""
_OFF_SCREEN = ("osmesa", "egl")
"""Libraries that render off-screen. `osmesa` needs no graphics card and renders equally on every machine."""


async def in_processes(
    jobs: Iterable[J], work: Callable[[J], Callable[[], R]], workers: int, on_done: Callable[[J, R], None]
) -> None:
    """Run a function for each job. Cancelling ends the processes.

    Args:
        jobs: The jobs.
        work: Function that returns, for a job, the function to run in a worker process. The latter must be picklable.
        workers: Number of processes.
        on_done: Called in this process with each job and its result, in order of completion.

    Raises:
        InfrastructureError: A process ended before its job, for example because memory ran out.
    """
    # Inherited by the processes. The matrices are small, so a second OpenBLAS thread would only busy-wait.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    loop = asyncio.get_running_loop()

    async def one(pool: ProcessPoolExecutor, job: J) -> None:
        try:
            # Not `wrap_future`, which cancels the future of the pool, at which the pool's thread fails (Python 3.11).
            future, done = pool.submit(work(job)), asyncio.Event()
            future.add_done_callback(lambda _: loop.call_soon_threadsafe(done.set))
            await done.wait()
            found = future.result()
        except BrokenProcessPool:
            raise InfrastructureError("a worker process ended before its job, perhaps for lack of memory") from None
        on_done(job, found)

    with _pool(workers) as pool:
        async with anyio.create_task_group() as tasks:
            for job in jobs:
                tasks.start_soon(one, pool, job)


@contextlib.contextmanager
def _pool(count: int, renderer: str | None = None) -> Generator[ProcessPoolExecutor]:
    """Start processes that run functions, and end them after the block: at once if it raises.

    Args:
        count: Number of processes.
        renderer: Graphics library with which they render; None if they do not.
    """
    before = multiprocessing.active_children()
    pool = ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare, initargs=(renderer,)
    )
    try:
        yield pool
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in before:
                process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


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
        with _pool(count, renderer) as pool:
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


def _prepare(renderer: str | None) -> None:
    """Prepare a worker process: select the graphics library before MuJoCo is imported, and discard all output.

    A broken graphics library and LAPACK write to the standard output without Python.
    """
    if renderer is not None:
        os.environ[RENDERER] = renderer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends this one
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sys.stdout.flush()
    sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, even if the parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _draws() -> bool:
    try:
        from evaluator.certify.pictures import check_renderer  # noqa: PLC0415 - after MUJOCO_GL is set, only in a worker process

        check_renderer()
    except Exception:  # noqa: BLE001 - each library raises different errors
        return False
    return True
