"""Writes pixels as PNG with zlib alone; images of eight bits, in colour or with a palette, need little code.

Source: W3C, Portable Network Graphics (third edition), sections 5 and 9.
"""

import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
_COLOURS = 256
"""Most colours of a palette."""


def png_of(pixels: Pixels) -> bytes:
    """A PNG file of (height, width, 3) pixels."""
    height, width, _ = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(_filtered(pixels), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


def small_png_of(pixels: Pixels) -> bytes:
    """A PNG file of (height, width, 3) pixels with 256 colours at most: a third of the size, and close to the eye."""
    height, width, _ = pixels.shape
    palette, indices = _palette(pixels)
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    lines = np.hstack([np.zeros((height, 1), np.uint8), indices]).tobytes()
    chunks = ((b"IHDR", header), (b"PLTE", palette.tobytes()), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


def _palette(pixels: Pixels) -> tuple[Pixels, NDArray[np.uint8]]:
    """Colours (n, 3), and for each pixel the index of its own.

    Source: Heckbert, Color image quantization for frame buffer display, 1982 (median cut); here the box with the
    largest sum of squared differences is cut, at its mean.
    """
    packed = (pixels.astype(np.uint32) * np.array((65536, 256, 1), np.uint32)).sum(axis=2, dtype=np.uint32)
    codes, place, counts = np.unique(packed, return_inverse=True, return_counts=True)
    colours = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=1).astype(np.float64)
    boxes = [_spread(colours, counts, np.arange(len(codes)))]
    while len(boxes) < _COLOURS:
        widest = max(range(len(boxes)), key=lambda index: boxes[index].error)
        if boxes[widest].error == 0:
            break
        box = boxes.pop(widest)
        below = colours[box.members, box.axis] <= box.mean[box.axis]
        boxes += [_spread(colours, counts, box.members[side]) for side in (below, ~below)]
    # Neighbours in brightness get neighbouring indices, which compress better.
    boxes.sort(key=lambda box: float(box.mean.sum()))
    index_of = np.empty(len(codes), np.uint8)
    for index, box in enumerate(boxes):
        index_of[box.members] = index
    palette = np.round([box.mean for box in boxes]).astype(np.uint8)
    return palette, index_of[place].reshape(pixels.shape[:2])


class _Box(NamedTuple):
    """Colours that share an entry of the palette."""

    members: NDArray[np.intp]
    mean: NDArray[np.float64]
    axis: int
    """Where they differ most."""
    error: float
    """Sum of their squared differences from the mean along the axis."""


def _spread(colours: NDArray[np.float64], counts: NDArray[np.intp], members: NDArray[np.intp]) -> _Box:
    weights = counts[members][:, None]
    mean = (colours[members] * weights).sum(axis=0) / weights.sum()
    errors = ((colours[members] - mean) ** 2 * weights).sum(axis=0)
    axis = int(errors.argmax())
    return _Box(members, mean, axis, float(errors[axis]) if len(members) > 1 else 0.0)


def _filtered(pixels: Pixels) -> bytes:
    """Each row as it is, or minus the row above (filter 2), whichever is nearer to zero and so compresses better."""
    rows = pixels.reshape(pixels.shape[0], -1)
    up = rows - np.vstack([np.zeros_like(rows[:1]), rows[:-1]])
    lines: list[bytes] = []
    for row, less in zip(rows, up, strict=True):
        takes_up = _weight(less) < _weight(row)
        lines.append((b"\x02" + less.tobytes()) if takes_up else (b"\x00" + row.tobytes()))
    return b"".join(lines)


def _weight(row: NDArray[np.uint8]) -> int:
    return int(np.abs(row.view(np.int8).astype(np.int16)).sum())


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
