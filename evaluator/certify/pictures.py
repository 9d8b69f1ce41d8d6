"""Draws scenes at their start, off-screen. Call it in a separate process; `drawing` says why."""

from typing import NamedTuple

from evaluator.certify.schematic import schematic
from evaluator.certify.visible import visible_parts
from physment_mcp.world.pictures.drawing import check_renderer
from physment_mcp.world.pictures.plates import plate
from physment_mcp.world.pictures.png import Pixels, small_png_of
from scenes import PackFiles, PublicPack, draw_knobs, drawn_mjcf, read_pack

__all__ = ["DrawnScene", "check_renderer", "draw_picture", "draw_scene"]

_SMALLER = 3
"""A thumbnail is this many times smaller than its picture."""


class DrawnScene(NamedTuple):
    """A scene at seed 0 as PNG files."""

    picture: bytes
    """960 by 640 pixels."""
    thumbnail: bytes
    """320 by 213 pixels."""


def draw_picture(files: PackFiles, seed: int = 0) -> Pixels:
    """A scene at its start as (height, width, 3); a schematic of its public half if no part of it may be shown.

    Light, camera, colours and what is written depend only on the visible parts and the public half of the pack, so the
    picture is the same for every seed.

    Raises:
        PackError: The pack cannot be read or drawn from.
    """
    pack = read_pack(files)
    public = PublicPack.of(files.scene_id, pack)
    visible = visible_parts(files, pack)
    if not visible.geoms:
        return schematic(public)
    mjcf = drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0)
    listed = [item.object_id for item in public.objects if not item.permissions.hidden]
    return plate(mjcf, visible, listed)


def draw_scene(files: PackFiles) -> DrawnScene:
    """The picture at seed 0 and its thumbnail."""
    pixels = draw_picture(files)
    height, width, _ = (length // _SMALLER for length in pixels.shape)
    blocks = pixels[: height * _SMALLER, : width * _SMALLER].reshape(height, _SMALLER, width, _SMALLER, 3)
    return DrawnScene(small_png_of(pixels), small_png_of(blocks.mean(axis=(1, 3)).round().astype("uint8")))
