"""Annotations of a plate: axes, scale bar, and labels of objects, placed where they cover least.

Independent of the engine. Positions are in pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from physment_mcp.world.pictures.framing import FIELD_DEG, View, camera_axes
from physment_mcp.world.pictures.overlay import LINE, Colour, Overlay
from physment_mcp.world.readings import Array

PAD = 6
"""Padding at the sides of a label's text [px]."""
_GAPS = (10, 26, 50, 84, 130, 190)
"""Distances of a label from its object that are tried [px]."""
_MISLEADING = 250
"""Penalty for a label that is as near to another object as to its own; a pixel of distance costs 12."""
_BORDER = 4
"""Smallest distance of a label from the edge of the image [px]."""

Box = tuple[float, float, float, float]
"""Left, top, right and bottom [px]."""
INK: Colour = (31, 41, 55)
SOFT: Colour = (90, 102, 120)
PAPER: Colour = (255, 255, 255)
_AXES: Mapping[str, Colour] = {"x": (200, 48, 48), "y": (30, 130, 60), "z": (40, 88, 200)}
_EDGE = 22
"""Distance of axes, scale bar and notes from the edge of the image [px]."""
_AXIS = 58
"""Length of an axis that is perpendicular to the line of sight [px]."""
_BAR = (110, 260)
"""Smallest and largest length of the scale bar [px]; its length is the largest round number that fits."""


@dataclass(frozen=True, slots=True)
class Optics:
    """Projects points of space into an image."""

    view: View
    width: int
    height: int

    @property
    def pixels_per_metre(self) -> float:
        """Scale at the point that the camera looks at [px/m]."""
        return self.height / 2 / np.tan(np.radians(FIELD_DEG) / 2) / self.view.distance

    def places(self, points: Array) -> Array:
        """Project points (n, 3) [m] to positions (n, 2) [px]; NaN for points behind the camera."""
        seen = (points - self.view.centre) @ camera_axes().T
        depth = seen[:, 2] + self.view.distance
        depth = np.where(depth > 1e-6 * self.view.distance, depth, np.nan)
        scale = (self.pixels_per_metre * self.view.distance / depth)[:, None]
        return np.array((self.width / 2, self.height / 2)) + seen[:, :2] * (1, -1) * scale

    def shows(self, points: Array) -> bool:
        """Return whether the centre of the points is inside the image."""
        x, y = middle(box_of(self.places(points)))
        # A comparison with NaN is false, so what lies behind the camera is outside too.
        return 0 <= x <= self.width and 0 <= y <= self.height


def label_of(object_id: str, name: str) -> str:
    """Return the label of an object, such as `glider (object_1)`; its id if it has no other name."""
    return object_id if name == object_id else f"{name} ({object_id})"


def round_length(metres: float) -> float:
    """Round a length down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(power * max(step for step in (1, 2, 5) if step * power <= metres * (1 + 1e-9)))


def written_length(metres: float) -> str:
    """Format a round length with the unit that needs the fewest digits."""
    for factor, unit in ((1.0, "m"), (100.0, "cm"), (1000.0, "mm")):
        if metres * factor >= 0.999:
            return f"{metres * factor:.0f} {unit}"
    return f"{metres:.0e} m"


@dataclass(frozen=True, slots=True)
class Label:
    """A label that has not been placed yet."""

    text: str
    width: int
    """Width of the text [px]."""
    thing: Box
    """Bounding box of the object that the label names."""


def arranged(labels: Sequence[Label], size: tuple[int, int], taken: Sequence[Box]) -> list[tuple[Box, bool]]:
    """Place labels.

    Args:
        labels: The labels, in order of priority.
        size: Width and height of the image.
        taken: Boxes of the annotations that are already placed.

    Returns:
        For each label its box, and whether a line must connect it to its distant object.
    """
    used, found = list(taken), list[tuple[Box, bool]]()
    for label in labels:
        others = [other.thing for other in labels if other is not label]
        gap, spot = min(_choices(label), key=lambda choice: _cost(*choice, label.thing, size, used, others))
        used.append(spot)
        found.append((spot, gap > _GAPS[0] or _misleads(spot, label.thing, others)))
    return found


def _choices(label: Label) -> list[tuple[int, Box]]:
    """Return candidate boxes around an object at several distances, and one on it."""
    width, height = label.width + 2 * PAD, LINE + 2
    x, y = middle(label.thing)
    on = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    sides = [side for side in product((0, -1, 1), (-1, 1, 0)) if any(side)]
    return [(gap, _placed(label.thing, (width, height), gap, side)) for gap in _GAPS for side in sides] + [(0, on)]


def _cost(gap: int, spot: Box, thing: Box, size: tuple[int, int], used: Sequence[Box], others: Sequence[Box]) -> float:
    whole = (spot[2] - spot[0]) * (spot[3] - spot[1])
    inside = _overlap(spot, (_BORDER, _BORDER, size[0] - _BORDER, size[1] - _BORDER))
    hidden = sum(_overlap(spot, other) for other in others) + 0.6 * _overlap(spot, thing)
    written = sum(_overlap(spot, other) for other in used)
    return 40 * (whole - inside) + 30 * written + 4 * hidden + 12 * gap + _MISLEADING * _misleads(spot, thing, others)


def _misleads(spot: Box, thing: Box, others: Sequence[Box]) -> bool:
    """Return whether a label seems to belong to another object than its own.

    This is so if the edge of another object is less than `_GAPS[0]` farther away than the edge of its own object, or
    if the centre of another object is nearer.
    """
    edges, middles = _distance(spot, thing) + _GAPS[0], float(np.hypot(*np.subtract(middle(thing), middle(spot))))
    return any(
        _distance(spot, other) < edges or np.hypot(*np.subtract(middle(other), middle(spot))) < middles
        for other in others
    )


def box_of(places: Array) -> Box:
    """Bounding box of positions (n, 2)."""
    low, high = places.min(axis=0), places.max(axis=0)
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def middle(box: Box) -> tuple[float, float]:
    """Return the centre of a box."""
    return (box[0] + box[2]) / 2, (box[1] + box[3]) / 2


def _placed(box: Box, size: tuple[float, float], gap: float, side: tuple[int, int]) -> Box:
    """Return a box of this size beside another box.

    `side` is -1, 0 or 1 for left, centred and right, and the same for above, centred and below.

    """
    x = {-1: box[0] - gap - size[0], 0: (box[0] + box[2] - size[0]) / 2, 1: box[2] + gap}[side[0]]
    y = {-1: box[1] - gap - size[1], 0: (box[1] + box[3] - size[1]) / 2, 1: box[3] + gap}[side[1]]
    return (x, y, x + size[0], y + size[1])


def _distance(one: Box, other: Box) -> float:
    """Return the distance between the nearest points of two boxes [px]."""
    across = max(one[0] - other[2], other[0] - one[2], 0.0)
    return float(np.hypot(across, max(one[1] - other[3], other[1] - one[3], 0.0)))


def _overlap(one: Box, other: Box) -> float:
    """Shared area [px²]."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return width * height if width > 0 and height > 0 else 0.0


def annotate(overlay: Overlay, optics: Optics, objects: Mapping[str, Array], notes: Sequence[str]) -> None:
    """Draw the axes, the scale bar, the labels and the notes.

    Args:
        overlay: The layer to draw on.
        optics: The projection.
        objects: Label of an object → its corners (n, 3) [m], which are inside the image.
        notes: Lines of text at the upper edge of the image.
    """
    taken = [_axes(overlay, optics), _scale(overlay, optics)]
    taken += _notes(overlay, notes)
    things = {name: box_of(optics.places(corners)) for name, corners in objects.items()}
    ordered = sorted(things.items(), key=lambda item: (item[1][1], item[1][0]))
    labels = [Label(name, overlay.width(name), thing) for name, thing in ordered]
    for label, (spot, joined) in zip(labels, arranged(labels, (optics.width, optics.height), taken), strict=True):
        _label(overlay, label, spot, joined)


def _axes(overlay: Overlay, optics: Optics) -> Box:
    """Draw arrows along x, y and z in the lower left corner."""
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
    """Draw a scale bar in the lower right corner; its length is a round number, such as 0.1 m."""
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
