"""One page of HTML with a card for each scene: its thumbnail, name, rung and category. It needs no other file."""

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.errors import UsageError
from evaluator.pages.scene_table import SCENES_PAGE
from evaluator.report.notebook import pictures_folder, thumbnails
from evaluator.scores.grouping import NO_RUNG
from scenes import Category, Pack, PackFiles, Rung


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
