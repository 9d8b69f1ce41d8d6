"""Plates: large images of scenes for readers, with sky and ground, soft shadows, axes, a scale bar and labels.

Agents get the small images of `drawing`. Like that module, this one needs a separate process.
"""

import contextlib
from collections.abc import Collection, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from physment_mcp.world.pictures.annotations import Optics, annotate
from physment_mcp.world.pictures.drawing import GeomBox, boxes_of, staged, view_on
from physment_mcp.world.pictures.overlay import Overlay, Pixels
from physment_mcp.world.pictures.studio import HEIGHT, WIDTH, Ground, Studio
from physment_mcp.world.readings import Array

ROOM = 1.18
"""Factor on the camera's distance that leaves room for labels."""
_FRAMES = 24
"""Number of frames that are averaged."""
_CELLS = 9.0
"""Smallest number of cells of the ground grid across the image."""
_MOST = 6
"""Largest number of names in a line."""
NO_FLOOR = "the grid is no part of the scene"
"""Note below an image whose grid is not part of the scene."""


def plate(mjcf: str, objects: Sequence[str], notes: Sequence[str] = ()) -> Pixels:
    """Render the plate of a model (HEIGHT, WIDTH, 3).

    Args:
        mjcf: The visible bodies, written by `picture_model`; not empty.
        objects: Bodies to label: beside them, or in a line of names if they are not drawn.
        notes: Further lines.
    """
    model, data = staged(mjcf)
    boxes = boxes_of(model, data)
    found = view_on(model, boxes, WIDTH / HEIGHT)
    view = replace(found, distance=found.distance * ROOM)
    optics = Optics(view, WIDTH, HEIGHT)
    ground = ground_below(model, boxes, optics)
    named = named_corners(model, boxes, objects)
    inside = {name: corners for name, corners in named.items() if optics.shows(corners)}
    absent = [name for name in objects if name not in inside]
    lines = [f"not shown: {_listed(absent)}"] if absent else []
    if ground is not None:
        lines.append(NO_FLOOR)
    overlay = Overlay(WIDTH, HEIGHT)
    annotate(overlay, optics, inside, [*lines, *notes])
    with contextlib.closing(Studio(mjcf, view, ground)) as studio:
        return overlay.over(studio.shoot(_FRAMES))


def _listed(names: Sequence[str]) -> str:
    """Join names in a line; if there are many, the last ones are replaced by their number."""
    return ", ".join(names) if len(names) <= _MOST else f"{', '.join(names[:_MOST])} and {len(names) - _MOST} more"


def named_corners(model: mujoco.MjModel, boxes: Sequence[GeomBox], objects: Collection[str]) -> dict[str, Array]:
    """Return, for each object, the corners of its drawn geoms."""
    found: dict[str, list[Array]] = {}
    for geom, corners, _ in boxes:
        name = model.body(int(model.geom_bodyid[geom])).name
        if name in objects:
            found.setdefault(name, []).append(corners)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def ground_below(model: mujoco.MjModel, boxes: Sequence[GeomBox], optics: Optics) -> Ground | None:
    """Return the position of the grid; None if the scene has a visible floor.

    Args:
        model: The model.
        boxes: Boxes of its geoms, at one moment or at several.
        optics: The projection.
    """
    endless = [box for box in boxes if model.geom_rbound[box.geom] <= 0]
    if any(box.is_level for box in endless):
        return None
    view = optics.view
    lowest, gap = np.inf, 0.0
    for geom, corners, _ in boxes:
        # Parts far outside the picture do not decide: the grid would be out of sight.
        bounded = model.geom_rbound[geom] > 0
        inside = float(np.abs(corners.mean(axis=0) - view.centre).max()) < 2 * view.extent
        if bounded and inside and corners[:, 2].min() < lowest:
            lowest = float(corners[:, 2].min())
            # What can move hangs over the grid; what is fixed may stand on it.
            moves = model.body_weldid[model.geom_bodyid[geom]] != 0
            gap = min(0.12 * view.extent, 0.25 * float(np.ptp(corners[:, 2]))) if moves else 0.0
    if not np.isfinite(lowest):
        lowest = float(view.centre[2])
    across = optics.width / optics.pixels_per_metre
    # A hair lower, so that faces that lie in the grid do not flicker through it.
    return Ground(lowest - gap - 1e-3 * view.extent, across / _CELLS)
