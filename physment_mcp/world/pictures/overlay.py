"""Draws lines, boxes, arrows and text over pixels, and encodes PNG, all by Pillow. Knows no engine.

Positions are (x, y) in pixels from the upper left corner.
"""

import io
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
Place = tuple[float, float]

LINE = 30
"""Height of a line of text [px]."""
_LETTERS = 24
"""Size of the letters [px]."""
_FINER = 3
"""Pixels drawn per pixel, in each direction, because Pillow does not antialias."""
_CLEAR = (255, 255, 255, 0)


class Overlay:
    """A transparent layer on which shapes and texts are drawn."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        self._image = Image.new("RGBA", (width * _FINER, height * _FINER), _CLEAR)
        self._draw = ImageDraw.Draw(self._image)
        self._font = ImageFont.load_default(_LETTERS * _FINER)

    def over(self, pixels: Pixels) -> Pixels:
        """Composite the layer over pixels (height, width, 3)."""
        layer = self._image.resize(self._size, Image.Resampling.BOX)
        return np.asarray(Image.alpha_composite(Image.fromarray(pixels).convert("RGBA"), layer).convert("RGB"))

    def line(self, start: Place, end: Place, width: float, colour: Colour, opacity: float = 1.0) -> None:
        """Draw a line with round ends."""
        fill = _filled(colour, opacity)
        self._draw.line(_finer(start, end), fill, round(width * _FINER))
        for x, y in (start, end):
            self._draw.ellipse(_finer((x - width / 2, y - width / 2), (x + width / 2, y + width / 2)), fill)

    def box(self, low: Place, high: Place, radius: float, colour: Colour, opacity: float = 1.0) -> None:
        """Draw a filled box with rounded corners."""
        self._draw.rounded_rectangle(_finer(low, high), radius * _FINER, _filled(colour, opacity))

    def dashes(self, low: Place, high: Place, width: float, colour: Colour) -> None:
        """Draw the outline of a box in dashes."""
        (left, top), (right, bottom) = low, high
        corners = ((left, top), (right, top), (right, bottom), (left, bottom), (left, top))
        for start, end in pairwise(corners):
            length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
            # An odd number of pieces, of which every second one is drawn, puts a dash into each corner.
            pieces = 2 * max(1, round(length / 24)) + 1
            marks = np.linspace(start, end, pieces + 1)
            for place in range(0, pieces, 2):
                self.line(tuple(marks[place]), tuple(marks[place + 1]), width, colour)

    def arrow(self, start: Place, end: Place, width: float, colour: Colour) -> None:
        """Draw a line that ends in a triangle; a line shorter than the triangle becomes a dot."""
        along = np.subtract(end, start)
        length, head = float(np.hypot(*along)), 4.5 * width
        if length < head:
            self.line(start, end, 2 * width, colour)
            return
        ahead = along / length
        aside, neck = np.array((-ahead[1], ahead[0])) * head * 0.42, np.array(end) - ahead * head
        self.line(start, tuple(neck), width, colour)
        self._draw.polygon(_finer(end, tuple(neck + aside), tuple(neck - aside)), _filled(colour, 1.0))

    def text(self, text: str, left: float, top: float, colour: Colour) -> None:
        """Draw a line of text, vertically centred in the `LINE` pixels below `top`."""
        place = (left * _FINER, (top + LINE / 2) * _FINER)
        self._draw.text(place, text, _filled(colour, 1.0), self._font, anchor="lm")

    def width(self, text: str) -> int:
        """Return the width of a line of text [px]."""
        return int(np.ceil(self._font.getlength(text) / _FINER))


def png_of(pixels: Pixels, colours: int | None = None) -> bytes:
    """Encode (height, width, 3) pixels as PNG, with at most `colours` colours (2 to 256); None for all."""
    image, file = Image.fromarray(pixels), io.BytesIO()
    if colours is not None:
        image = image.quantize(colours, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    image.save(file, "PNG", optimize=True)
    return file.getvalue()


def _finer(*places: Place) -> list[Place]:
    return [(x * _FINER, y * _FINER) for x, y in places]


def _filled(colour: Colour, opacity: float) -> tuple[int, int, int, int]:
    return (*colour, round(255 * opacity))
