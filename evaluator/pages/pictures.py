"""Draws pictures of many scenes in separate processes, or says in one sentence why it cannot.

A missing or broken graphics library may end the process that loads it, and MuJoCo chooses the library only once, when
it is imported. Therefore this process never draws.
"""

import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from scenes import PackFiles

RENDERER = "MUJOCO_GL"
"""Environment variable with which MuJoCo chooses its graphics library."""
_OFF_SCREEN = ("osmesa", "egl")
"""Libraries that draw without a screen; `osmesa` needs no graphics card and draws the same on every machine."""


class NoRenderer(Exception):
    """No library on this machine draws off-screen; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The picture of a scene and its thumbnail as PNG files, both empty if drawing failed."""

    png: bytes = b""
    thumbnail: bytes = b""
    fault: str = ""
    """Why drawing failed; empty if it did not."""


def draw_pictures(packs: Sequence[PackFiles], jobs: int) -> Mapping[int, Picture]:
    """Draw the pictures of scenes with `jobs` processes.

    Returns:
        Scene id → picture.

    Raises:
        NoRenderer: No library on this machine draws off-screen.
    """
    chosen = os.environ.get(RENDERER)
    tried = (chosen,) if chosen else _OFF_SCREEN
    for renderer in tried:
        pool = ProcessPoolExecutor(
            jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare, initargs=(renderer,)
        )
        with pool:
            try:
                if pool.submit(_draws).result():
                    return dict(zip((files.scene_id for files in packs), pool.map(_draw, packs), strict=True))
            except BrokenProcessPool:
                continue
    raise NoRenderer(
        f"no pictures: nothing draws off-screen here ({RENDERER} as {' or '.join(tried)}); install libosmesa6,"
        " or leave them out with --no-pictures"
    )


def _prepare(renderer: str) -> None:
    """Choose the library before MuJoCo is imported, and discard the output of a broken one."""
    os.environ[RENDERER] = renderer
    sys.stdout.flush()
    sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)


def _draws() -> bool:
    try:
        from evaluator.certify.pictures import check_renderer  # noqa: PLC0415 - after the choice of the library, only in a worker process

        check_renderer()
    except Exception:  # noqa: BLE001 - each library raises different errors
        return False
    return True


def _draw(files: PackFiles) -> Picture:
    from evaluator.certify.pictures import draw_scene  # noqa: PLC0415 - as above

    try:
        return Picture(*draw_scene(files))
    except Exception as error:  # noqa: BLE001 - an engine error in one pack is reported and does not stop the others
        return Picture(fault=" ".join(str(error).split()) or repr(error))
