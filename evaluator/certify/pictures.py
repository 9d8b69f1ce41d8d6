"""Draws scenes at their start, off-screen. Call it in a separate process; `drawing` says why."""

# MuJoCo ships no type stubs.
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false

from evaluator.certify.visible import visible_parts
from physment_mcp.world.pictures.drawing import check_renderer, drawn, staged, view_on
from physment_mcp.world.pictures.png import Pixels, png_of
from scenes import PackFiles, draw_knobs, drawn_mjcf, read_pack

__all__ = ["check_renderer", "draw_picture", "draw_png"]


def draw_picture(files: PackFiles, seed: int = 0) -> Pixels | None:
    """A scene at its start as (height, width, 3); None if no part of it may be shown.

    Lights, camera and colours depend only on the visible parts, so the picture is the same for every seed.

    Raises:
        PackError: The pack cannot be read or drawn from.
    """
    pack = read_pack(files)
    visible = visible_parts(files, pack)
    if not visible.geoms:
        return None
    mjcf = drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0)
    model, data = staged(mjcf, visible)
    return drawn(model, data, view_on(model, data, visible))


def draw_png(files: PackFiles) -> bytes | None:
    """The picture at seed 0 as a PNG file."""
    pixels = draw_picture(files)
    return None if pixels is None else png_of(pixels)
