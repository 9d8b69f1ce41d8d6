"""Draws scenes at their start, off-screen. Call it in a separate process; `drawing` says why."""

from typing import NamedTuple

from evaluator.certify.schematic import schematic
from physment_mcp.scene import load_scene, load_variants
from physment_mcp.session import Session
from physment_mcp.visibility import bodies_of, markers_at_start, visibility_of
from physment_mcp.world.pictures.drawing import check_renderer
from physment_mcp.world.pictures.overlay import Pixels, png_of
from physment_mcp.world.pictures.plates import plate
from physment_mcp.world.pictures.showing import ShownBody, picture_model
from scenes import PackFiles

__all__ = ["DrawnScene", "check_renderer", "draw_picture", "draw_scene"]

_SMALLER = 3
"""A thumbnail is this many times smaller than its picture."""
_COLOURS = 128
"""Colours of a file: a third of the size of one with all; pixels are off by a quarter of a step of 256 in the mean."""
_MARKED = "grey spheres: only the position may be read"


class DrawnScene(NamedTuple):
    """A scene at seed 0 as PNG files."""

    picture: bytes
    """960 by 640 pixels."""
    thumbnail: bytes
    """320 by 213 pixels."""


def at_start(files: PackFiles, seed: int = 0) -> tuple[Session, list[ShownBody], list[ShownBody]]:
    """A session of a scene, the bodies of it that may be seen at the start, and markers for others.

    Raises:
        SceneError: The pack cannot be read or drawn from, or its model does not compile.
    """
    folder = files.folder.parent
    session = Session(load_scene(files.scene_id, seed, folder))
    visibility = visibility_of(session.scene, load_variants(files.scene_id, folder))
    return session, bodies_of(session, visibility.now(session)), markers_at_start(session, visibility)


def draw_picture(files: PackFiles, seed: int = 0) -> Pixels:
    """A scene at its start as (height, width, 3); a schematic of its public half if nothing of it may be shown.

    Raises:
        SceneError: As for `at_start`.
    """
    session, bodies, markers = at_start(files, seed)
    if not any(body.pose for body in (*bodies, *markers)):
        return schematic(session.scene.public)
    names = [item.object_id for item in session.known()]
    return plate(picture_model([*bodies, *markers]), names, [_MARKED] if markers else [])


def draw_scene(files: PackFiles) -> DrawnScene:
    """The picture at seed 0 and its thumbnail."""
    pixels = draw_picture(files)
    height, width, _ = (length // _SMALLER for length in pixels.shape)
    blocks = pixels[: height * _SMALLER, : width * _SMALLER].reshape(height, _SMALLER, width, _SMALLER, 3)
    return DrawnScene(png_of(pixels, _COLOURS), png_of(blocks.mean(axis=(1, 3)).round().astype("uint8"), _COLOURS))
