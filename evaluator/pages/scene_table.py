"""Generates `scenes.md`: a row for each scene, by category, and the scenes that correspond to UTOPIA's kinds."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from evaluator.pages.listing import Listing
from evaluator.report.markdown import escaped, markdown_table
from scenes import Category

KINDS: Mapping[str, tuple[int, ...]] = {
    "motion": (13, 21, 59),
    "friction": (14, 57, 64, 103),
    "free fall": (7, 12, 51, 25),
    "horizontal projectile": (54,),
    "elastic collision": (15, 73, 18, 62),
    "inclined plane": (11, 53, 17, 8),
}
"""UTOPIA's six kinds of scenes → the most similar scenes here, most similar first."""

SCENES_PAGE = Path("reference", "scenes.md")
"""Where the page is in the documentation."""
PICTURES = "scenes"
"""Folder of the pictures, next to the page."""
SMALL = "small"
"""Folder of the thumbnails, in that of the pictures."""

_TITLES = ("picture", "scene", "name", "concepts", "answer", "iterations, interventions", "objects")

_HEAD = """\
# The scenes

Made from the packs by `make pages`; do not edit. It shows nothing that a pack hides from an agent: no answers, no
hidden values or their ranges, no hidden objects, no methods.

- **Picture**: the laboratory at the start, seen from the side of −y, with x to the right and z up. It shows only what
  is the same for every seed: no hidden object, and no part whose position, size or colour depends on the seed. If
  nothing is left, it is a schematic of what an agent may read. Each leads to a larger picture with axes and a scale;
  the scale holds at the distance of the middle of the picture.
- **Answer**: its options; or its numbers, each with its unit, and how close is close enough.
- **Iterations, interventions**: the number of turns of the reference protocol, and of calls in them that change the
  world; minimum and maximum over several seeds, because the length at one seed could reveal the answer.
- **Objects**: the number of objects that an agent knows from the start.
"""

_KINDS_HEAD = """\
## Scene kinds of UTOPIA

UTOPIA (Liu et al., *Mind's Eye: Grounded Language Model Reasoning through Simulation*, ICLR 2023) asks about six kinds
of scenes. The scenes below are about the same physics, most similar first. They are not copies: here the deciding
quantity is not given but has to be measured.
"""


def scenes_page(listings: Sequence[Listing], pictured: Collection[int]) -> str:
    """The text of the page.

    Args:
        listings: The scenes, ordered by id.
        pictured: Ids of the scenes that have a picture.
    """
    used = {listing.category for listing in listings}
    parts = [_HEAD]
    for category in (category for category in (*Category, None) if category in used):
        rows = [_row(listing, listing.scene in pictured) for listing in listings if listing.category is category]
        parts.append(f"## {category.value if category else 'without category'}\n\n{markdown_table(_TITLES, rows)}\n")
    kinds = _kinds({listing.scene: listing.name for listing in listings})
    return "\n".join([*parts, *([kinds] if kinds else [])]).rstrip() + "\n"


def _row(listing: Listing, pictured: bool) -> tuple[str, ...]:
    return (
        _picture(listing.scene) if pictured else "no picture drawn",
        f'<a id="scene-{listing.scene}"></a>{listing.scene}',
        escaped(listing.name),
        escaped(", ".join(listing.concepts)),
        escaped(listing.answer),
        f"{_span(listing.steps.iterations)}, {_span(listing.steps.interventions)}" if listing.steps else "–",
        str(listing.in_sight),
    )


def _span(ends: tuple[int, int]) -> str:
    return "–".join(map(str, sorted(set(ends))))


def _picture(scene: int) -> str:
    small = f'<img src="{PICTURES}/{SMALL}/scene{scene}.png" width="160" alt="Scene {scene} at its start">'
    return f"[{small}]({PICTURES}/scene{scene}.png)"


def _kinds(names: Mapping[int, str]) -> str:
    rows = [
        (kind, "; ".join(f"[{scene}](#scene-{scene}) {escaped(names[scene])}" for scene in found))
        for kind, scenes in KINDS.items()
        if (found := [scene for scene in scenes if scene in names])
    ]
    return f"{_KINDS_HEAD}\n{markdown_table(('kind', 'scenes'), rows)}" if rows else ""
