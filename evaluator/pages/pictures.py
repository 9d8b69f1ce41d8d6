"""Draws pictures of many scenes in separate processes, or says why it cannot; the gallery that shows them.

A missing or broken graphics library may end the process that loads it, and MuJoCo chooses the library only once, when
it is imported. Therefore this process never draws.
"""

import base64
import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.errors import UsageError
from evaluator.pages.scene_table import SCENES_PAGE
from evaluator.report.notebook import pictures_folder, thumbnails
from evaluator.scores.grouping import NO_RUNG
from scenes import Category, Pack, PackFiles, Rung

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


@dataclass(frozen=True, slots=True)
class Card:
    """What is shown of a scene."""

    scene: int
    name: str
    rung: str
    category: str
    """Empty if it has none."""
    thumbnail: str
    """A PNG file in base64; empty if there is none."""


def write_gallery(packs: Mapping[PackFiles, Pack], file: Path, page: str | None, scenes_dir: Path | None) -> None:
    """Write the page.

    Args:
        packs: The scenes, in the order in which they are shown.
        file: Where to.
        page: Address of the page about all scenes, to whose rows the cards lead; None for the one in the documentation
            beside the folder of packs, if there is one.
        scenes_dir: Folder of the packs; the suite's own if None.

    Raises:
        UsageError: The file cannot be written.
    """
    found = thumbnails(list(packs), scenes_dir)
    cards = [_card(files, pack, found.get(files.scene_id, b"")) for files, pack in packs.items()]
    text = gallery(cards, _stored_page(file, scenes_dir) if page is None else page)
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from error


def gallery(cards: Sequence[Card], page: str) -> str:
    """The text of the page; without an address of the page about all scenes, the cards lead nowhere."""
    environment = Environment(
        loader=PackageLoader("evaluator.pages"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    rungs, categories = ({getattr(card, field) for card in cards} for field in ("rung", "category"))
    return environment.get_template("gallery.html.j2").render(
        cards=cards,
        page=page,
        rungs=[rung for rung in (*Rung, NO_RUNG) if rung in rungs],
        categories=[category.value for category in Category if category.value in categories],
    )


def _card(files: PackFiles, pack: Pack, thumbnail: bytes) -> Card:
    category = pack.category
    return Card(
        files.scene_id,
        pack.metadata.scene_name,
        category.rung.value if category else NO_RUNG,
        category.value if category else "",
        base64.b64encode(thumbnail).decode("ascii"),
    )


def _stored_page(file: Path, scenes_dir: Path | None) -> str:
    """Address of the stored page from the place of a file, empty if there is no such page."""
    stored = pictures_folder(scenes_dir).parent / SCENES_PAGE.name
    if not stored.is_file():
        return ""
    try:
        return quote(Path(os.path.relpath(stored, file.resolve().parent)).as_posix())
    except ValueError:  # on Windows, from another drive
        return stored.as_uri()
