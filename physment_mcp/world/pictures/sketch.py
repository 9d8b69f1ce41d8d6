"""Draws what a task describes but the model does not show.

These are rings at the last position readings of objects, and cords, springs, rods, rails and pulleys. Only the ends of
such parts are known, so no part has a true size. Independent of the engine.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from physment_mcp.world.pictures.annotations import INK, Optics
from physment_mcp.world.pictures.overlay import Colour, Overlay, Place
from physment_mcp.world.readings import Array

RING = 17
"""Radius of the ring around a reading [px]."""
_PULLEY, _RAIL, _COIL = 14, 4, 9
"""Radius of a pulley, half distance of the lines of a rail, and half width of a spring [px]."""
_COILS, _STRAIGHT = 9, 0.12
"""Number of coils of a spring, and share of it that is straight, at each end."""
_DASHES = 9
_READ: Colour = (150, 60, 10)
_TASK: Colour = (90, 102, 120)


class SketchedPart(NamedTuple):
    """A cord, spring, rod, rail or pulley of the task."""

    kind: str
    points: Sequence[str | Sequence[float]]
    """Ends of the part: an object id for the object's centre, or a position [m]."""


def draw_reading(overlay: Overlay, optics: Optics, position: Sequence[float]) -> None:
    """Draw a dashed ring at the position of the last reading [m]."""
    (centre,) = optics.places(np.array([position]))
    if np.isfinite(centre).all():
        _ring(overlay, centre, RING, _READ, dashed=True)


def draw_part(overlay: Overlay, optics: Optics, course: SketchedPart, places: Mapping[str, Sequence[float]]) -> None:
    """Draw a cord, spring, rod, rail or pulley; nothing while the position of one of its ends is unknown.

    Args:
        overlay: The layer to draw on.
        optics: The projection.
        course: The cord, spring, rod, rail or pulley.
        places: Object → its drawn position or its last reading [m].
    """
    known = [places.get(point) if isinstance(point, str) else point for point in course.points]
    found = [point for point in known if point is not None]
    flat = optics.places(np.array(found)) if len(found) == len(known) else np.array([[np.nan, np.nan]])
    if not np.isfinite(flat).all():
        return
    if course.kind == "pulley":
        _ring(overlay, flat[0], _PULLEY, INK, dashed=False)
        return
    along = flat[-1] - flat[0]
    across = np.array((-along[1], along[0])) / (float(np.hypot(*along)) or np.inf)
    match course.kind:
        case "rail":
            lines = [flat + side * across for side in (-_RAIL, _RAIL)]
        case "spring":
            lines = [_coiled(flat[0], along, across)]
        case _:
            lines = [flat]
    for line in lines:
        for start, end in pairwise(line):
            overlay.line(_place(start), _place(end), 5 if course.kind == "rod" else 2.5, _TASK)


def _coiled(start: Array, along: Array, across: Array) -> Array:
    """Return a zigzag (n, 2) [px] with straight ends."""
    shares = _STRAIGHT + (1 - 2 * _STRAIGHT) * (np.arange(2 * _COILS) + 0.5) / (2 * _COILS)
    sides = np.where(np.arange(2 * _COILS) % 2 == 0, _COIL, -_COIL)
    turns = start + shares[:, None] * along + sides[:, None] * across
    return np.array([start, start + _STRAIGHT * along, *turns, start + (1 - _STRAIGHT) * along, start + along])


def _ring(overlay: Overlay, centre: Array, radius: float, colour: Colour, *, dashed: bool) -> None:
    angles = np.linspace(0, 2 * np.pi, 4 * _DASHES + 1)
    rim = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for number, (start, end) in enumerate(pairwise(rim)):
        if not dashed or number % 4 < 2:
            overlay.line(_place(start), _place(end), 3, colour)


def _place(point: Array) -> Place:
    return float(point[0]), float(point[1])
