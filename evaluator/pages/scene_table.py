"""`scenes.md`: a row for each scene, by category, and which scenes are of the kinds that UTOPIA has."""

from collections.abc import Mapping, Sequence

from evaluator.markdown import escaped, markdown_table
from evaluator.pages.listing import Listing
from scenes import Category

KINDS: Mapping[str, tuple[int, ...]] = {
    "motion": (13, 21, 59, 101),
    "friction": (14, 57, 64, 36),
    "free fall": (7, 12, 51, 25),
    "horizontal projectile": (87, 54, 35),
    "elastic collision": (15, 73, 18, 62),
    "inclined plane": (11, 53, 8, 26),
}
"""The six kinds of scenes of UTOPIA → the scenes here that come nearest, the nearest first."""

PICTURES = "scenes"
"""Folder of the pictures, beside the page."""

_TITLES = ("picture", "scene", "name", "concepts", "answer", "iterations, interventions", "objects")

_HEAD = """\
# The scenes

Made from the packs by `make pages`; do not edit. What a pack keeps from an agent is not told here either: no answers,
no hidden values or their ranges, no hidden objects, no methods.

- **Picture**: the laboratory at the start, seen from the side of −y, with x to the right and z up. It shows what is the
  same in every seed: nothing hidden, and no part whose place, size or colour is drawn from the seed.
- **Answer**: its kind, with its unit or the number of options.
- **Iterations, interventions**: how many turns the reference protocol takes, and in them how many calls that change the
  world; the least and the most over a few seeds, since its length at one seed could tell of the answer.
- **Objects**: how many an agent knows from the start.
"""

_KINDS_HEAD = """\
## Scene kinds of UTOPIA

UTOPIA (Liu et al., *Mind's Eye: Grounded Language Model Reasoning through Simulation*, ICLR 2023) asks about six kinds
of scenes. These scenes are about the same physics, the nearest first. They are relatives and not copies: here the
quantity that decides is not told but has to be measured.
"""


def scenes_page(listings: Sequence[Listing], pictured: Mapping[int, bool], *, drawn: bool) -> str:
    """The page.

    Args:
        listings: The scenes, by ascending id.
        pictured: Whether there is a picture of a scene.
        drawn: Whether pictures were drawn at all.
    """
    categories = [one for one in (*Category, None) if any(listing.category is one for listing in listings)]
    parts = [_HEAD]
    for category in categories:
        rows = [_row(one, pictured.get(one.scene, False), drawn) for one in listings if one.category is category]
        parts.append(f"## {category.value if category else 'without category'}\n\n{markdown_table(_TITLES, rows)}\n")
    kinds = _kinds({one.scene: one.name for one in listings})
    return "\n".join([*parts, *([kinds] if kinds else [])]).rstrip() + "\n"


def _row(one: Listing, pictured: bool, drawn: bool) -> tuple[str, ...]:
    return (
        _picture(one, pictured, drawn),
        f'<a id="scene-{one.scene}"></a>{one.scene}',
        escaped(one.name),
        escaped(", ".join(one.concepts)),
        escaped(one.answer),
        f"{_span(one.steps.iterations)}, {_span(one.steps.interventions)}" if one.steps else "–",
        str(one.in_sight),
    )


def _span(ends: tuple[int, int]) -> str:
    return "–".join(map(str, sorted(set(ends))))


def _picture(one: Listing, pictured: bool, drawn: bool) -> str:
    if pictured:
        return f'<img src="{PICTURES}/scene{one.scene}.png" width="160" alt="Scene {one.scene} at its start">'
    return "nothing to be seen" if drawn else "no picture drawn"


def _kinds(names: Mapping[int, str]) -> str:
    rows = [
        (kind, "; ".join(f"[{scene}](#scene-{scene}) {escaped(names[scene])}" for scene in found))
        for kind, scenes in KINDS.items()
        if (found := [scene for scene in scenes if scene in names])
    ]
    return f"{_KINDS_HEAD}\n{markdown_table(('kind', 'scenes'), rows)}" if rows else ""
