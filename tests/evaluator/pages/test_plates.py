"""What plates consist of: palettes, scales and places of labels."""

import io
import zlib

import numpy as np
import pytest
from PIL import Image

from physment_mcp.world.pictures.framing import View, camera_axes
from physment_mcp.world.pictures.placement import Label, Optics, arranged, round_length, written_length
from physment_mcp.world.pictures.png import png_of, small_png_of


def test_a_png_decodes_to_its_pixels() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 4, 3), dtype=np.uint8)
    pixels[2:] = pixels[1]
    png = png_of(pixels)
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    size = int.from_bytes(png[33:37], "big")
    lines = np.frombuffer(zlib.decompress(png[41 : 41 + size]), np.uint8).reshape(5, 13)
    rows = np.zeros((6, 12), np.uint8)
    for place, line in enumerate(lines):
        rows[place + 1] = line[1:] + (rows[place] if line[0] == 2 else 0)
    assert np.array_equal(rows[1:].reshape(5, 4, 3), pixels)
    assert set(lines[:, 0]) == {0, 2}


def test_a_small_png_decodes_to_the_colours_nearest_to_its_pixels() -> None:
    few = np.random.default_rng(1).integers(0, 256, (200, 3), dtype=np.uint8)[np.arange(600) % 200].reshape(20, 30, 3)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(small_png_of(few))).convert("RGB")), few)
    ramp = np.linspace(0, 255, 64).round().astype(np.uint8)
    many = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None, :], np.uint8(90)), axis=2)
    read = np.asarray(Image.open(io.BytesIO(small_png_of(many))).convert("RGB")).astype(int)
    assert np.abs(read - many).max() < 20


def test_a_scale_is_a_round_length_and_true_at_the_middle() -> None:
    optics = Optics(View(np.zeros(3), 7.0, 3.0), 960, 640)
    (left, right) = optics.places(np.array([-camera_axes()[0] / 2, camera_axes()[0] / 2]))
    assert right[0] - left[0] == pytest.approx(optics.pixels_per_metre)
    assert [round_length(metres) for metres in (0.012, 0.5, 1.99, 49.0)] == pytest.approx([0.01, 0.5, 1.0, 20.0])
    assert [written_length(metres) for metres in (0.002, 0.01, 0.5, 20.0)] == ["2 mm", "1 cm", "50 cm", "20 m"]


def test_labels_overlap_neither_each_other_nor_the_edge() -> None:
    boxes = [Label("object_1", 90, (400 + 12 * k, 300, 470 + 12 * k, 380)) for k in range(6)]
    spots = [spot for spot, _ in arranged(boxes, (960, 640), [(0, 0, 200, 40)])]
    for place, (left, top, right, bottom) in enumerate(spots):
        assert 0 <= left < right <= 960
        assert 0 <= top < bottom <= 640
        assert not [o for o in spots[:place] if left < o[2] and o[0] < right and top < o[3] and o[1] < bottom]
