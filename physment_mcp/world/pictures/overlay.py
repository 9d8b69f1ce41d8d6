"""Draws lines, boxes, arrows and text over pixels, and encodes PNG, all by Pillow. Independent of the engine.

Positions are (x, y) in pixels from the upper left corner.
"""

import io
import unicodedata
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
"""Pixels drawn per pixel of a still image, in each direction."""
_CLEAR = (255, 255, 255, 0)
_WRITTEN = str.maketrans({"²": "^2", "³": "^3", "×": "x", "−": "-", "–": "-", "→": "->", "µ": "u", "Ω": "ohm"})
"""Characters that the font lacks, and how they are written. Others lose their accents, or become question marks."""


class Overlay:
    """A transparent layer on which shapes and texts are drawn.

    Args:
        width: Width [px].
        height: Height [px].
        finer: Pixels drawn per pixel, in each direction, because Pillow does not antialias.
    """

    def __init__(self, width: int, height: int, finer: int = _FINER) -> None:
        self._size, self._finer = (width, height), finer
        self._image = Image.new("RGBA", (width * finer, height * finer), _CLEAR)
        self._draw = ImageDraw.Draw(self._image)
        self._font = ImageFont.load_default(_LETTERS * finer)

    def over(self, pixels: Pixels) -> Pixels:
        """Composite the layer over pixels (height, width, 3)."""
        layer = self._image.resize(self._size, Image.Resampling.BOX)
        return np.asarray(Image.alpha_composite(Image.fromarray(pixels).convert("RGBA"), layer).convert("RGB"))

    def line(self, start: Place, end: Place, width: float, colour: Colour, opacity: float = 1.0) -> None:
        """Draw a line with round ends."""
        fill = _filled(colour, opacity)
        self._draw.line(self._places(start, end), fill, round(width * self._finer))
        for x, y in (start, end):
            self._draw.ellipse(self._places((x - width / 2, y - width / 2), (x + width / 2, y + width / 2)), fill)

    def box(self, low: Place, high: Place, radius: float, colour: Colour, opacity: float = 1.0) -> None:
        """Draw a filled box with rounded corners."""
        self._draw.rounded_rectangle(self._places(low, high), radius * self._finer, _filled(colour, opacity))

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
        self._draw.polygon(self._places(end, tuple(neck + aside), tuple(neck - aside)), _filled(colour, 1.0))

    def text(self, text: str, left: float, top: float, colour: Colour) -> None:
        """Draw a line of text, vertically centred in the `LINE` pixels below `top`."""
        place = (left * self._finer, (top + LINE / 2) * self._finer)
        self._draw.text(place, _plain(text), _filled(colour, 1.0), self._font, anchor="lm")

    def width(self, text: str) -> int:
        """Return the width of a line of text [px]."""
        return int(np.ceil(self._font.getlength(_plain(text)) / self._finer))

    def _places(self, *places: Place) -> list[Place]:
        return [(x * self._finer, y * self._finer) for x, y in places]


def png_of(pixels: Pixels, colours: int | None = None) -> bytes:
    """Encode (height, width, 3) pixels as PNG, with at most `colours` colours (2 to 256); None for all."""
    image, file = Image.fromarray(pixels), io.BytesIO()
    if colours is not None:
        image = image.quantize(colours, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    image.save(file, "PNG", optimize=True)
    return file.getvalue()


def _plain(text: str) -> str:
    """Replace the characters that the font lacks."""
    letters = (one for one in unicodedata.normalize("NFKD", text.translate(_WRITTEN)) if not unicodedata.combining(one))
    return "".join(one if one.isascii() or one in "·°…" else "?" for one in letters)


def _filled(colour: Colour, opacity: float) -> tuple[int, int, int, int]:
    return (*colour, round(255 * opacity))
