"""Writes pixels as PNG with zlib alone; a colour image of eight bits needs little code.

Source: W3C, Portable Network Graphics (third edition), sections 5 and 9.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def png_of(pixels: Pixels) -> bytes:
    """A PNG file of (height, width, 3) pixels."""
    height, width, _ = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(_filtered(pixels), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


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
