"""Processes that render off-screen.

A missing or broken graphics library may crash the process that loads it, and MuJoCo selects the library only once, when
it is imported. Therefore this process never renders.
"""

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Generator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

RENDERER = "MUJOCO_GL"
"""Environment variable with which MuJoCo selects its graphics library."""
_OFF_SCREEN = ("osmesa", "egl")
"""Libraries that render off-screen. `osmesa` needs no graphics card and renders equally on every machine."""


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
