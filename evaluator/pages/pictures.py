"""Pictures of many scenes, drawn in processes of their own; or one sentence that says why there are none.

A graphics library that is missing or broken may end the process that loads it, and MuJoCo chooses the library once,
when it is imported. So nothing here draws in this process.
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
"""Environment variable by which MuJoCo chooses how to draw."""
_OFF_SCREEN = ("osmesa", "egl")
"""What draws without a screen; the first needs no graphics card, and draws the same on every machine."""


class NoRenderer(Exception):
    """Nothing on this machine draws off-screen; one sentence."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The picture of a scene: a PNG file, or none where nothing may be shown."""

    png: bytes | None
    fault: str = ""
    """Why it could not be drawn, if it could not."""


def draw_pictures(packs: Sequence[PackFiles], jobs: int) -> Mapping[int, Picture]:
    """The pictures of scenes, by id, drawn by `jobs` processes.

    Raises:
        NoRenderer: Nothing here draws off-screen.
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
                    return dict(zip((one.scene_id for one in packs), pool.map(_draw, packs), strict=True))
            except BrokenProcessPool:
                continue
    raise NoRenderer(
        f"no pictures: nothing draws off-screen here ({RENDERER} as {' or '.join(tried)}); install libosmesa6,"
        " or leave them out with --no-pictures"
    )


def _prepare(renderer: str) -> None:
    """Choose the library before MuJoCo is imported, and keep what a broken one writes to itself."""
    os.environ[RENDERER] = renderer
    sys.stdout.flush()
    sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)


def _draws() -> bool:
    try:
        from evaluator.certify.pictures import check_renderer  # noqa: PLC0415 - after the choice, in this process only

        check_renderer()
    except Exception:  # noqa: BLE001 - each library fails in its own way
        return False
    return True


def _draw(files: PackFiles) -> Picture:
    from evaluator.certify.pictures import draw_png  # noqa: PLC0415 - as above

    try:
        return Picture(draw_png(files))
    except Exception as error:  # noqa: BLE001 - whatever a pack makes the engine raise is a sentence, not a crash of ours
        return Picture(None, " ".join(str(error).split()) or repr(error))
