"""Renders pictures of scenes in worker processes, and writes the gallery that shows them."""

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.certify.processes import renderers
from evaluator.errors import UsageError
from evaluator.pages.scene_table import page_name
from evaluator.report.notebook import pictures_folder, thumbnails
from evaluator.scores.grouping import NO_RUNG
from scenes import Category, Pack, PackFiles, Rung


@dataclass(frozen=True, slots=True)
class Picture:
    """A scene's picture and thumbnail as PNG files; both empty if rendering failed."""

    png: bytes = b""
    thumbnail: bytes = b""
    fault: str = ""
    """Why rendering failed; empty if it succeeded."""


def draw_pictures(packs: Sequence[PackFiles], jobs: int) -> Mapping[int, Picture]:
    """Render the pictures of scenes with `jobs` worker processes.

    Returns:
        Scene id → picture.

    Raises:
        NoRenderer: No library on this machine renders off-screen.
    """
    with renderers(jobs) as pool:
        return dict(zip((files.scene_id for files in packs), pool.map(_draw, packs), strict=True))


def _draw(files: PackFiles) -> Picture:
    from evaluator.certify.pictures import draw_scene  # noqa: PLC0415 - after the choice of the library, only in a worker process

    try:
        return Picture(*draw_scene(files))
    except Exception as error:  # noqa: BLE001 - an engine error in one pack is reported and does not stop the others
        return Picture(fault=" ".join(str(error).split()) or repr(error))


@dataclass(frozen=True, slots=True)
class Card:
    """Content of a scene's card in the gallery."""

    scene: int
    name: str
    rung: str
    category: str
    """Empty if the scene has no category."""
    thumbnail: str
    """PNG file in base64; empty if there is none."""
    difficulty: str = ""
    """Its calibrated difficulty; empty if it has none."""


def write_gallery(
    packs: Mapping[PackFiles, Pack],
    file: Path,
    page: str | None,
    scenes_dir: Path | None,
    difficulties: Mapping[int, str],
) -> None:
    """Write the gallery.

    Args:
        packs: The scenes, in the order in which the gallery shows them.
        file: Output file.
        page: Address of the page of a scene, to which its card links, with `{scene}` for the number; None for the
            documentation pages next to the folder of packs, if they exist.
        scenes_dir: Folder of the packs; the suite's own if None.
        difficulties: Scene → its calibrated difficulty in short, for those that have one.

    Raises:
        UsageError: The file cannot be written.
    """
    found = thumbnails(list(packs), scenes_dir)
    cards = [
        _card(files, pack, found.get(files.scene_id, b""), difficulties.get(files.scene_id, ""))
        for files, pack in packs.items()
    ]
    text = gallery(cards, _stored_page(file, scenes_dir) if page is None else page)
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from error


def gallery(cards: Sequence[Card], page: str) -> str:
    """Render the gallery. If the address of the pages is empty, the cards are not links."""
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


def _card(files: PackFiles, pack: Pack, thumbnail: bytes, difficulty: str) -> Card:
    category = pack.category
    return Card(
        files.scene_id,
        pack.metadata.scene_name,
        category.rung.value if category else NO_RUNG,
        category.value if category else "",
        base64.b64encode(thumbnail).decode("ascii"),
        difficulty,
    )


def _stored_page(file: Path, scenes_dir: Path | None) -> str:
    """Return the address of the documentation pages of scenes relative to a file; empty if there are none."""
    stored = pictures_folder(scenes_dir)
    if not any(stored.glob(page_name("*"))):
        return ""
    try:
        folder = quote(Path(os.path.relpath(stored, file.resolve().parent)).as_posix())
    except ValueError:  # on Windows, from another drive
        folder = stored.as_uri()
    return f"{folder}/{page_name('{scene}')}"
