"""Tests of plates: files, shapes, scale bars and positions of labels."""

import io
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from evaluator.certify.pictures import draw_picture
from physment_mcp.world.pictures import plates
from physment_mcp.world.pictures.annotations import Box, Label, Optics, arranged, round_length, written_length
from physment_mcp.world.pictures.framing import View, camera_axes
from physment_mcp.world.pictures.overlay import LINE, Colour, Overlay, Pixels, png_of
from physment_mcp.world.pictures.plates import HEIGHT, WIDTH
from scenes import find_pack


def test_a_png_holds_its_pixels_and_one_with_few_colours_the_nearest() -> None:
    few = np.random.default_rng(1).integers(0, 256, (200, 3), dtype=np.uint8)[np.arange(600) % 200].reshape(20, 30, 3)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png_of(few)))), few)
    ramp = np.linspace(0, 255, 64).round().astype(np.uint8)
    many = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None, :], np.uint8(90)), axis=2)
    small = Image.open(io.BytesIO(png_of(many, 256)))
    assert small.mode == "P"
    assert np.abs(np.asarray(small.convert("RGB")).astype(int) - many).max() < 20


def test_shapes_and_texts_cover_pixels_by_their_opacity() -> None:
    overlay = Overlay(60, 40)
    overlay.box((10, 10), (50, 30), 0, (255, 0, 0), 0.5)
    overlay.line((0, 35), (60, 35), 4, (0, 0, 255))
    drawn = overlay.over(np.full((40, 60, 3), 255, np.uint8))
    assert drawn[20, 30] == pytest.approx([255, 127, 127], abs=2)
    assert drawn[35, 30].tolist() == [0, 0, 255]
    assert drawn[2, 2].tolist() == [255, 255, 255]
    overlay.text("object_1", 5, 5, (0, 0, 0))
    written = overlay.over(np.full((40, 60, 3), 255, np.uint8))
    assert overlay.width("object_1") > overlay.width("x") > 0
    assert written[:, 5:].min() == 0


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


class RecordedOverlay(Overlay):
    """An overlay that remembers its texts and their boxes."""

    drawn: ClassVar[list["RecordedOverlay"]] = []

    def __init__(self, width: int, height: int, finer: int = 1) -> None:
        super().__init__(width, height, 1)
        self.texts: list[tuple[str, Box]] = []
        self.drawn.append(self)

    def text(self, text: str, left: float, top: float, colour: Colour) -> None:
        self.texts.append((text, (left, top, left + self.width(text), top + LINE)))
        super().text(text, left, top, colour)


class DarkStudio:
    """A studio that renders nothing."""

    def __init__(self, *_: object) -> None:
        pass

    def shoot(self, _: int) -> Pixels:
        return np.zeros((HEIGHT, WIDTH, 3), np.uint8)

    def close(self) -> None:
        pass


@pytest.mark.parametrize("scene", [8, 13, 29, 110])
def test_texts_of_a_scenes_picture_overlap_neither_each_other_nor_the_edge(
    scene: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plates, "Overlay", RecordedOverlay)
    monkeypatch.setattr(plates, "Studio", DarkStudio)
    monkeypatch.setattr(RecordedOverlay, "drawn", [])
    draw_picture(find_pack(scene))
    (overlay,) = RecordedOverlay.drawn
    assert [text for text, _ in overlay.texts if text.endswith("(object_1)")]
    for place, (text, (left, top, right, bottom)) in enumerate(overlay.texts):
        assert 0 <= left < right <= WIDTH, text
        assert 0 <= top < bottom <= HEIGHT, text
        covered = [
            other
            for other, box in overlay.texts[:place]
            if left < box[2] and box[0] < right and top < box[3] and box[1] < bottom
        ]
        # The letters of axes that point away from the reader lie close together.
        assert [other for other in covered if {other, text} - {"x", "y", "z"}] == [], text
