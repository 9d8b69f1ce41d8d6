"""Texts as masks, in the font that MuJoCo carries: pictures need no other library, and look alike on every machine.

As `drawing`, it needs a process of its own. The font has the printable characters of ASCII.
"""

from collections.abc import Generator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

from physment_mcp.world.pictures.placement import LINE
from physment_mcp.world.readings import Array

_FINER = 2
"""Pixels of the font for each pixel of a mask, in each direction; their mean gives smooth edges."""
_WIDTH, _HEIGHT = 3000, LINE * _FINER
"""Size of the strip on which a text is written [px of the font]."""
_BASELINE = 0.15
"""Lower edge of a text on the strip, as a share of its height; letters are then in the middle of a mask."""
_LONGEST = 120
"""Longest text [characters]; a longer one might not fit on the strip."""


class Letters:
    """Writes texts while its context is current."""

    def __init__(self, context: mujoco.MjrContext) -> None:
        self._context = context
        self._strip = mujoco.MjrRect(0, 0, _WIDTH, _HEIGHT)
        self._kept: dict[str, Array] = {}

    def mask(self, text: str) -> Array:
        """How much of each pixel is covered by the text, 0 to 1, (LINE, its width).

        Raises:
            ValueError: The text is too long or has characters that the font lacks.
        """
        if len(text) > _LONGEST or not text.isascii() or not text.isprintable():
            raise ValueError(f"{text!r} cannot be written: at most {_LONGEST} printable characters of ASCII")
        if text not in self._kept:
            self._kept[text] = self._written(text)
        return self._kept[text]

    def width(self, text: str) -> int:
        """Width of the mask of a text [px]."""
        return self.mask(text).shape[1]

    def _written(self, text: str) -> Array:
        pixels: NDArray[np.uint8] = np.zeros((_HEIGHT, _WIDTH, 3), np.uint8)
        mujoco.mjr_rectangle(self._strip, 0, 0, 0, 1)
        mujoco.mjr_text(mujoco.mjtFont.mjFONT_NORMAL, text, self._context, 0, _BASELINE, 1, 1, 1)
        mujoco.mjr_readPixels(pixels, None, self._strip, self._context)
        width = sum(int(self._context.charWidth[ord(letter)]) for letter in text)
        width = min(_WIDTH, width + width % _FINER + 2 * _FINER)
        blocks = pixels[::-1, :width, 0].reshape(LINE, _FINER, width // _FINER, _FINER)
        return blocks.mean(axis=(1, 3)) / 255


@contextmanager
def lettering() -> Generator[Letters]:
    """Open a context for texts; what was drawn into before is current no longer."""
    size = f'<global offwidth="{_WIDTH}" offheight="{_HEIGHT}"/><quality offsamples="0"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><visual>{size}</visual></mujoco>")
    surface = mujoco.GLContext(_WIDTH, _HEIGHT)
    surface.make_current()
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_300)
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        yield Letters(context)
    finally:
        context.free()
        surface.free()
