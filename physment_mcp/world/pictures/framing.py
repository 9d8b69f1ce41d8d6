"""Places the camera: computes its target and its distance from the drawn bodies. Independent of the engine."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AZIMUTH_DEG, ELEVATION_DEG = 106.0, -15.0
"""Direction of the camera: from -y, slightly from the right and from above; x points to the right, z up."""
FIELD_DEG = 30.0
"""Vertical field of view."""
_ROUND_ALL, _ROUND_ONE = 1.2, 2.5
"""Limits of how much of a fixture is shown around the objects: a multiple of the extent of all objects, or of the size
of the largest one.
"""
_FILLED, _ALONE = 0.86, 0.5
"""Share of the image that objects may fill, and that a single object without surroundings may fill."""


@dataclass(frozen=True, slots=True)
class View:
    """The target point of the camera, its distance, and the extent of the visible part."""

    centre: Array
    distance: float
    extent: float


@dataclass(frozen=True, slots=True)
class FramedParts:
    """The parts that a view must frame."""

    things: Array
    """Corners of the main objects (n, 3) [m]."""
    fixtures: list[Array]
    """Corners of each larger part (8, 3) [m]."""
    size: float
    """Size of the largest single object [m]."""


def view_of(subject: FramedParts, aspect: float) -> View:
    """Return the view that shows all main objects completely, and the near parts of the fixtures around them.

    Args:
        subject: The parts to frame.
        aspect: Width of the image over its height.
    """
    things, fixtures = subject.things, subject.fixtures
    low, high = things.min(axis=0), things.max(axis=0)
    reach = min(_ROUND_ALL * float((high - low).max()), _ROUND_ONE * subject.size)
    near = [np.clip(corners, low - reach, high + reach) for corners in fixtures]
    # A fixture that is wholly elsewhere has been clipped to a flat patch; it is left out.
    near = [corners for corners in near if np.all(np.ptp(corners, axis=0) > 0)]
    points = np.concatenate([things, *near])
    axes = camera_axes()
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    tall = np.tan(np.radians(FIELD_DEG) / 2) * (_FILLED if len(points) > 8 else _ALONE)
    limits = np.array([tall * aspect, tall])
    distance = 0.0
    for _ in range(8):
        across, along = (points - centre) @ axes[:2].T, (points - centre) @ axes[2]
        distance = float((np.abs(across) / limits - along[:, None]).max())
        seen = across / (distance + along)[:, None]
        # Perspective moves the middle of the box away from the middle of the picture; this moves it back.
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        centre = centre + distance * (middle @ axes[:2])
    return View(centre, distance, float(np.linalg.norm(np.ptp(points, axis=0))))


def camera_axes() -> Array:
    """Return the directions right, up and forward as rows (3, 3)."""
    azimuth, elevation = np.radians(AZIMUTH_DEG), np.radians(ELEVATION_DEG)
    level, rise = np.cos(elevation), np.sin(elevation)
    forward = np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, rise])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    return np.array([right, np.cross(right, forward), forward])
