"""What is written on a plate: the axes, the scale, and the ids of objects where they hide least. Knows no engine."""

from collections.abc import Mapping, Sequence

import numpy as np

from physment_mcp.world.pictures.framing import camera_axes
from physment_mcp.world.pictures.overlay import LINE, Colour, Overlay
from physment_mcp.world.pictures.placement import (
    PAD,
    Box,
    Label,
    Optics,
    arranged,
    box_of,
    middle,
    round_length,
    written_length,
)
from physment_mcp.world.readings import Array

INK: Colour = (31, 41, 55)
SOFT: Colour = (90, 102, 120)
PAPER: Colour = (255, 255, 255)
_AXES: Mapping[str, Colour] = {"x": (200, 48, 48), "y": (30, 130, 60), "z": (40, 88, 200)}
_EDGE = 22
"""Distance of what is written from the edge of the picture [px]."""
_AXIS = 58
"""Length of an axis that is seen at a right angle [px]."""
_BAR = (110, 260)
"""Shortest and longest scale bar [px]; the longest round length that fits is drawn."""


def annotate(overlay: Overlay, optics: Optics, objects: Mapping[str, Array], notes: Sequence[str]) -> None:
    """Write the axes, the scale, the labels and the notes.

    Args:
        overlay: What is drawn over the picture.
        optics: Where the points are.
        objects: What is written beside an object → its corners (n, 3) [m], which the picture shows.
        notes: Lines below the picture's upper edge.
    """
    taken = [_axes(overlay, optics), _scale(overlay, optics)]
    taken += _notes(overlay, notes)
    things = {name: box_of(optics.places(corners)) for name, corners in objects.items()}
    ordered = sorted(things.items(), key=lambda item: (item[1][1], item[1][0]))
    labels = [Label(name, overlay.width(name), thing) for name, thing in ordered]
    for label, (spot, joined) in zip(labels, arranged(labels, (optics.width, optics.height), taken), strict=True):
        _label(overlay, label, spot, joined)


def _axes(overlay: Overlay, optics: Optics) -> Box:
    """Arrows along x, y and z, in the lower left corner."""
    right, up, forward = camera_axes()
    origin = np.array((_EDGE + 22.0, optics.height - _EDGE - 22.0))
    overlay.box((_EDGE - 8, optics.height - _EDGE - 114), (_EDGE + 112, optics.height - _EDGE + 8), 10, PAPER, 0.55)
    # What points away from the reader is drawn first.
    for place in sorted(range(3), key=lambda axis: -forward[axis]):
        name = "xyz"[place]
        tip = origin + _AXIS * np.array((right[place], -up[place]))
        overlay.arrow((origin[0], origin[1]), (tip[0], tip[1]), 3.5, _AXES[name])
        beyond = tip + (tip - origin) / max(1.0, float(np.hypot(*(tip - origin)))) * 13
        overlay.text(name, beyond[0] - overlay.width(name) / 2, beyond[1] - LINE / 2, _AXES[name])
    return (_EDGE - 8, optics.height - _EDGE - 114, _EDGE + 112, optics.height - _EDGE + 8)


def _scale(overlay: Overlay, optics: Optics) -> Box:
    """A bar of a round length, in the lower right corner."""
    metres = round_length(_BAR[1] / optics.pixels_per_metre)
    length = metres * optics.pixels_per_metre
    right, y = optics.width - _EDGE - 8, optics.height - _EDGE - 8
    left = right - length
    overlay.box((left - 14, y - LINE - 16), (right + 14, y + 16), 10, PAPER, 0.55)
    overlay.line((left, y), (right, y), 4, INK)
    for x in (left, right):
        overlay.line((x, y - 8), (x, y + 8), 3, INK)
    text = written_length(metres)
    overlay.text(text, (left + right - overlay.width(text)) / 2, y - LINE - 8, INK)
    return (left - 14, y - LINE - 16, right + 14, y + 16)


def _notes(overlay: Overlay, notes: Sequence[str]) -> list[Box]:
    boxes: list[Box] = []
    for row, note in enumerate(notes):
        top = _EDGE - 8 + row * (LINE + 6)
        box = (_EDGE - 8.0, top, _EDGE + 12.0 + overlay.width(note), top + LINE + 4.0)
        overlay.box(box[:2], box[2:], 8, PAPER, 0.7)
        overlay.text(note, _EDGE, top + 2, SOFT)
        boxes.append(box)
    return boxes


def _label(overlay: Overlay, label: Label, spot: Box, joined: bool) -> None:
    x, y = middle(label.thing)
    if joined:
        near = (min(max(x, spot[0]), spot[2]), min(max(y, spot[1]), spot[3]))
        overlay.line(near, (x, y), 4, PAPER, 0.6)
        overlay.line(near, (x, y), 1.6, INK)
    overlay.box(spot[:2], spot[2:], 7, PAPER, 0.85)
    overlay.text(label.text, spot[0] + PAD, spot[1] + 1, INK)
