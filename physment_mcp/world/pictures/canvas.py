"""Lines, boxes, arrows and texts on pixels, with smooth edges. Knows no engine.

Each shape is drawn by the distance of every pixel from it: a pixel within half a pixel of the edge is covered in part.
Places are (x, y) in pixels from the upper left corner.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from physment_mcp.world.pictures.png import Pixels
from physment_mcp.world.readings import Array

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
Place = tuple[float, float]
_MARGIN = 2
"""Pixels around a shape that its smooth edge may touch."""


class Canvas:
    """Pixels that are drawn on."""

    def __init__(self, pixels: Array | Pixels) -> None:
        """Start with pixels (height, width, 3)."""
        self._pixels = np.array(pixels, dtype=np.float64)

    @property
    def pixels(self) -> Pixels:
        """What has been drawn, (height, width, 3)."""
        return np.round(self._pixels).astype(np.uint8)

    def line(self, start: Place, end: Place, width: float, colour: Colour, share: float = 1.0) -> None:
        """A line with round ends; `share` is its opacity."""
        low = np.minimum(start, end) - width
        high = np.maximum(start, end) + width
        x, y, window = self._window(low, high)
        along = np.subtract(end, start)
        part = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max(float(along @ along), 1e-9)
        part = np.clip(part, 0, 1)
        away = np.hypot(x - start[0] - part * along[0], y - start[1] - part * along[1])
        self._cover(window, np.clip(width / 2 - away + 0.5, 0, 1) * share, colour)

    def box(self, low: Place, high: Place, radius: float, colour: Colour, share: float = 1.0) -> None:
        """A filled box with round corners."""
        x, y, window = self._window(np.array(low), np.array(high))
        dx = np.abs(x - (low[0] + high[0]) / 2) - (high[0] - low[0]) / 2 + radius
        dy = np.abs(y - (low[1] + high[1]) / 2) - (high[1] - low[1]) / 2 + radius
        away = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(np.maximum(dx, dy), 0) - radius
        self._cover(window, np.clip(0.5 - away, 0, 1) * share, colour)

    def dashes(self, low: Place, high: Place, width: float, colour: Colour) -> None:
        """The outline of a box in dashes."""
        (left, top), (right, bottom) = low, high
        corners = ((left, top), (right, top), (right, bottom), (left, bottom), (left, top))
        for start, end in pairwise(corners):
            length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
            # An odd number of pieces, of which every second one is drawn, puts a dash into each corner.
            pieces = 2 * max(1, round(length / 24)) + 1
            marks = np.linspace(start, end, pieces + 1)
            for place in range(0, pieces, 2):
                first, last = marks[place], marks[place + 1]
                self.line((first[0], first[1]), (last[0], last[1]), width, colour)

    def arrow(self, start: Place, end: Place, width: float, colour: Colour) -> None:
        """A line that ends in a triangle; shorter than the triangle, it is a disc."""
        along = np.subtract(end, start)
        length, head = float(np.hypot(*along)), 4.5 * width
        if length < head:
            self.line(start, end, 2 * width, colour)
            return
        ahead = along / length
        aside = np.array((-ahead[1], ahead[0])) * head * 0.42
        neck = np.array(end) - ahead * head
        self.line(start, (neck[0], neck[1]), width, colour)
        self._polygon([np.array(end), neck + aside, neck - aside], colour)

    def text(self, mask: Array, left: float, top: float, colour: Colour) -> None:
        """A text by its mask, as `lettering` makes it; what lies outside the picture is left out."""
        x, y = round(left), round(top)
        height, width = self._pixels.shape[:2]
        first, last = max(0, -x), min(mask.shape[1], width - x)
        above, below = max(0, -y), min(mask.shape[0], height - y)
        if first < last and above < below:
            window = (slice(y + above, y + below), slice(x + first, x + last))
            self._cover(window, mask[above:below, first:last], colour)

    def _polygon(self, corners: Sequence[Array], colour: Colour) -> None:
        """A filled convex polygon."""
        x, y, window = self._window(np.min(corners, axis=0), np.max(corners, axis=0))
        middle = np.mean(corners, axis=0)
        cover = np.ones_like(x + y)
        for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
            along = (end - start) / np.hypot(*(end - start))
            normal = np.array((-along[1], along[0]))
            normal *= -np.sign(normal @ (middle - start)) or 1.0
            away = (x - start[0]) * normal[0] + (y - start[1]) * normal[1]
            cover = np.minimum(cover, np.clip(0.5 - away, 0, 1))
        self._cover(window, cover, colour)

    def _window(self, low: Array, high: Array) -> tuple[Array, Array, tuple[slice, slice]]:
        """Centres of the pixels near a shape, and which they are."""
        height, width = self._pixels.shape[:2]
        left, top = np.clip(np.floor(low).astype(int) - _MARGIN, 0, (width, height))
        right, bottom = np.clip(np.ceil(high).astype(int) + _MARGIN, 0, (width, height))
        x = np.arange(left, right)[None, :] + 0.5
        y = np.arange(top, bottom)[:, None] + 0.5
        return x, y, (slice(top, bottom), slice(left, right))

    def _cover(self, window: tuple[slice, slice], cover: Array, colour: Colour) -> None:
        part = self._pixels[window]
        part += cover[..., None] * (np.array(colour) - part)
