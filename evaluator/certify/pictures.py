"""Renders images of scenes in their initial state, and schematics of scenes without visible bodies.

The images depend only on the public half of a pack: they show no hidden value and are the same for every seed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from physment_mcp.scene import load_scene, load_variants
from physment_mcp.session import Session
from physment_mcp.visibility import bodies_of, markers_at_start, visibility_of
from physment_mcp.world.pictures.annotations import INK, PAPER, SOFT, label_of
from physment_mcp.world.pictures.drawing import check_renderer
from physment_mcp.world.pictures.overlay import LINE, Overlay, Pixels, png_of
from physment_mcp.world.pictures.plates import GROUND, HEIGHT, SKY, WIDTH, plate
from physment_mcp.world.pictures.showing import ShownBody, picture_model
from scenes import PackFiles, Permissions, PublicPack

_COMMON = ("shape", "size", "radius", "density", "mass", "position", "orientation", "velocity")
"""Attributes that a schematic lists as withheld if they may not be read. Only objects on hinges have the other ones."""
_EDGE, _GAP, _TITLE = 40, 28, 104
_COLUMNS = 3
_LARGEST = (560.0, 300.0)
"""Largest size of an outline in a schematic [px]."""
_STEP = LINE + 4


def schematic(pack: PublicPack) -> Pixels:
    """Draw an image (HEIGHT, WIDTH, 3) of the objects that an agent knows from the start."""
    listed = [item for item in pack.objects if not item.permissions.hidden]
    overlay = Overlay(WIDTH, HEIGHT)
    columns = min(_COLUMNS, max(1, len(listed)))
    rows = -(-max(1, len(listed)) // columns)
    width = min(_LARGEST[0], (WIDTH - 2 * _EDGE - (columns - 1) * _GAP) / columns)
    height = min(_LARGEST[1], (HEIGHT - _TITLE - _EDGE - (rows - 1) * _GAP) / rows)
    first = (
        (WIDTH - columns * width - (columns - 1) * _GAP) / 2,
        _TITLE + (HEIGHT - _TITLE - _EDGE - rows * height - (rows - 1) * _GAP) / 2,
    )
    overlay.text("Schematic: no part looks the same in every variant", _EDGE, 30, INK)
    overlay.text("places and sizes are not shown", _EDGE, 30 + _STEP, SOFT)
    for place, item in enumerate(listed):
        left = first[0] + place % columns * (width + _GAP)
        top = first[1] + place // columns * (height + _GAP)
        low, high = (left, top), (left + width, top + height)
        overlay.box(low, high, 4, PAPER, 0.6)
        overlay.dashes(low, high, 2.5, INK)
        lines = _card(overlay, item.permissions, width - 2 * LINE)
        heads = [(text, INK) for text in _wrapped(overlay, label_of(item.object_id, item.name), width - 2 * LINE)]
        start = max(top + 12, top + (height - (len(heads) + len(lines)) * _STEP) / 2)
        for row, (text, colour) in enumerate([*heads, *((line, SOFT) for line in lines)]):
            if start + (row + 1) * _STEP <= top + height:
                overlay.text(text, left + LINE, start + row * _STEP, colour)
    return overlay.over(_backdrop())


def _backdrop() -> Pixels:
    """Return a vertical colour gradient from sky to ground."""
    share = np.linspace(0, 1, HEIGHT)[:, None, None]
    rows = np.array(SKY) * (1 - share) + np.array(GROUND) * share
    return np.round(np.broadcast_to(rows * 255, (HEIGHT, WIDTH, 3))).astype(np.uint8)


def _card(overlay: Overlay, may: Permissions, width: float) -> list[str]:
    """Return the label of an object, wrapped to a width."""
    withheld = [word for word in _COMMON if word not in may.readable]
    sealed = "not sealed" if may.actuate else "sealed: it cannot be pushed or moved"
    texts = (
        f"may be read: {', '.join(may.readable) or 'nothing'}",
        f"withheld: {', '.join(withheld) or 'nothing'}",
        sealed,
    )
    return ["", *(line for text in texts for line in _wrapped(overlay, text, width))]


def _wrapped(overlay: Overlay, text: str, width: float) -> Sequence[str]:
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and overlay.width(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


__all__ = ["DrawnScene", "check_renderer", "draw_picture", "draw_scene"]

_SMALLER = 3
"""Reduction factor of thumbnails."""
_COLOURS = 128
"""Size of the colour palette. Files are a third as large as in true colour; the mean error is 0.25 of 256 levels."""
_MARKED = "grey spheres: only the position may be read"


class DrawnScene(NamedTuple):
    """A scene at seed 0 as PNG files."""

    picture: bytes
    """PNG file of 960 by 640 pixels."""
    thumbnail: bytes
    """PNG file of 320 by 213 pixels."""


def at_start(files: PackFiles, seed: int = 0) -> tuple[Session, list[ShownBody], list[ShownBody]]:
    """Return a session of a scene, its initially visible bodies, and markers for its other objects.

    Raises:
        SceneError: The pack cannot be read, its hidden values cannot be sampled, or its model does not compile.
    """
    folder = files.folder.parent
    session = Session(load_scene(files.scene_id, seed, folder))
    visibility = visibility_of(session.scene, load_variants(files.scene_id, folder))
    return session, bodies_of(session, visibility.now(session)), markers_at_start(session, visibility)


def draw_picture(files: PackFiles, seed: int = 0) -> Pixels:
    """Render a scene in its initial state as an array (height, width, 3); a schematic if no body is visible.

    Raises:
        SceneError: As for `at_start`.
    """
    session, bodies, markers = at_start(files, seed)
    if not any(body.pose for body in (*bodies, *markers)):
        return schematic(session.scene.public)
    labels = {item.object_id: label_of(item.object_id, item.name) for item in session.known()}
    return plate(picture_model([*bodies, *markers]), labels, [_MARKED] if markers else [])


def draw_scene(files: PackFiles) -> DrawnScene:
    """Draw the image of a scene at seed 0 and its thumbnail."""
    pixels = draw_picture(files)
    height, width, _ = (length // _SMALLER for length in pixels.shape)
    blocks = pixels[: height * _SMALLER, : width * _SMALLER].reshape(height, _SMALLER, width, _SMALLER, 3)
    return DrawnScene(png_of(pixels, _COLOURS), png_of(blocks.mean(axis=(1, 3)).round().astype("uint8"), _COLOURS))
