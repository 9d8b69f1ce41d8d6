"""Moving plates: animated WebP images of visible bodies.

A frame has labels, the last readings, the cords, springs, rods, rails and pulleys that the task describes, and
captions. Like `drawing`, this module needs a separate process.
"""

import contextlib
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np
from PIL import Image

from physment_mcp.world.pictures.annotations import INK, PAD, PAPER, SOFT, Optics, annotate, box_of
from physment_mcp.world.pictures.drawing import Extras, GeomBox, boxes_of, placed, staged, view_on
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.overlay import LINE, Overlay, Place
from physment_mcp.world.pictures.plates import (
    HEIGHT,
    NO_FLOOR,
    ROOM,
    WIDTH,
    Ground,
    Studio,
    ground_below,
    named_corners,
)
from physment_mcp.world.pictures.showing import ShownBody, picture_model
from physment_mcp.world.pictures.sketch import RING, SketchedPart, draw_part, draw_reading
from physment_mcp.world.readings import Array

_ROWS, _EDGE = 3, 16
"""Number of captions, and their distance from the edge of the image [px]."""
_STRIP = _ROWS * (LINE + 6) + 12
"""Height of the strip of captions below the image [px]."""
_SIZE = (600, (HEIGHT + _STRIP) * 600 // WIDTH)
"""Width and height of the animation [px], to which each frame is reduced."""
_LIGHTS, _FINER = 1, 2
"""Number of light positions per frame, and pixels drawn per pixel of annotations; reducing the frame smooths both."""
_FRAMED = 60
"""Largest number of frames from which the camera's view is computed."""
_MARK, _MARK_ALONE_M = 0.035, 0.05
"""Half edge of the box that is framed around a reading: as a share of the largest distance in the image, and if nothing
else is shown [m].
"""
_QUALITIES = (80, 60, 40, 20)
"""Qualities of WebP that are tried, until the file is small enough."""


class ShownReading(NamedTuple):
    """The last position reading of an object that is not drawn."""

    position: Sequence[float]
    words: str
    """Label of the reading."""


class Shown(NamedTuple):
    """Everything that the frames of an animation show: bodies, and the apparatus that the task describes."""

    bodies: Sequence[ShownBody]
    courses: Sequence[SketchedPart]
    labels: Mapping[str, str]
    """Body → its label; bodies without one are labelled by their name."""


class Moment(NamedTuple):
    """One frame of an animation."""

    shown: int
    """Index, in the list of `Shown`, of what the frame draws."""
    poses: Mapping[str, Sequence[float]]
    """Body → position [m] and quaternion, 7 numbers."""
    read: Mapping[str, ShownReading]
    """Object that is not drawn → its last reading."""
    captions: Sequence[str]
    """Lines below the image; longer ones are cut off at the end."""
    clock: str
    """Text in the lower right corner."""
    duration_ms: int


def moving_plate(things: Sequence[Shown], moments: Sequence[Moment], most_bytes: int) -> bytes:
    """Render an animated WebP image, which plays for ever.

    Args:
        things: What the frames draw; `Moment.shown` is an index in this list.
        moments: The frames, in order; at least one.
        most_bytes: Largest size of the file.

    Raises:
        ValueError: The file would be larger even at the lowest quality.
    """
    frames = list(_frames(things, moments))
    durations = [moment.duration_ms for moment in moments]
    for quality in _QUALITIES:
        file = io.BytesIO()
        frames[0].save(
            file, "WEBP", save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=quality, method=4
        )
        if file.tell() <= most_bytes:
            return file.getvalue()
    raise ValueError(f"an animation of more than {most_bytes} bytes")


def _frames(things: Sequence[Shown], moments: Sequence[Moment]) -> Iterator[Image.Image]:
    stage = _staged(things, moments)
    for start, end in _runs(moments):
        shown = things[moments[start].shown]
        with contextlib.closing(Studio(_model(shown.bodies), stage.view, stage.ground)) as studio:
            names = {body.name for body in shown.bodies if body.pose}
            canvas, last = np.full((HEIGHT + _STRIP, WIDTH, 3), 255, np.uint8), None
            for moment in moments[start:end]:
                if moment.poses != last:
                    studio.place({name: pose for name, pose in moment.poses.items() if name in names})
                    canvas[:HEIGHT], last = studio.shoot(_LIGHTS), moment.poses
                whole = Image.fromarray(_annotated(shown, moment, stage).over(canvas))
                yield whole.resize(_SIZE, Image.Resampling.LANCZOS)


def _runs(moments: Sequence[Moment]) -> Iterator[tuple[int, int]]:
    """Yield the start and the end (exclusive) of each run of successive frames that draw the same bodies."""
    cuts = [place for place in range(1, len(moments)) if moments[place].shown != moments[place - 1].shown]
    yield from zip([0, *cuts], [*cuts, len(moments)], strict=True)


def _model(bodies: Sequence[ShownBody]) -> str:
    return picture_model(bodies) or "<mujoco/>"


class _Stage(NamedTuple):
    """The parts of an animation that all frames share: view, ground, and a model with the bodies of all frames."""

    view: View
    ground: Ground | None
    model: mujoco.MjModel
    data: mujoco.MjData
    objects: Collection[str]
    """Names of all objects that are drawn in any frame."""

    def boxes(self, poses: Mapping[str, Sequence[float]]) -> list[GeomBox]:
        """Put bodies at poses, and return the bounding boxes of their geoms and of those of the fixtures."""
        placed(self.model, self.data, {name: pose for name, pose in poses.items() if name in self.objects})
        names = [self.model.body(int(body)).name for body in self.model.geom_bodyid]
        here = boxes_of(self.model, self.data)
        return [box for box in here if names[box.geom] in poses or names[box.geom] not in self.objects]


def _staged(things: Sequence[Shown], moments: Sequence[Moment]) -> _Stage:
    """Compute a camera and a ground for everything that an animation shows."""
    bodies = {body.name: body for shown in things for body in shown.bodies}
    model, data = staged(_model(list(bodies.values())))
    objects = [name for name, body in bodies.items() if body.pose]
    stage = _Stage(View(np.zeros(3), 1.0, 1.0), None, model, data, objects)
    sampled = (*moments[:: -(-len(moments) // _FRAMED)], moments[-1])
    boxes = [box for moment in sampled for box in stage.boxes(moment.poses)]
    places = {tuple(one.position) for moment in moments for one in moment.read.values()}
    courses = [course for shown in things for course in shown.courses]
    points = [np.array([point]) for course in courses for point in course.points if not isinstance(point, str)]
    extras = Extras(objects, _marks(places, boxes, points), points)
    found = view_on(model, boxes, WIDTH / HEIGHT, extras)
    view = replace(found, distance=found.distance * ROOM)
    return stage._replace(view=view, ground=ground_below(model, boxes, Optics(view, WIDTH, HEIGHT)))


def _marks(places: Collection[Sequence[float]], boxes: Sequence[GeomBox], points: Sequence[Array]) -> list[Array]:
    """Return boxes around position readings. Their size depends only on the distances in the image."""
    if not places:
        return []
    whole = np.concatenate([np.array([*places]), *points, *(box.corners for box in boxes)])
    half = _MARK * float(np.ptp(whole, axis=0).max()) or _MARK_ALONE_M
    return [np.array(place) + half * np.array([*product((-1, 1), repeat=3)]) for place in places]


def _annotated(shown: Shown, moment: Moment, stage: _Stage) -> Overlay:
    """Draw the annotations of a frame: labels, readings, parts described by the task, captions and clock."""
    overlay, optics = Overlay(WIDTH, HEIGHT + _STRIP, _FINER), Optics(stage.view, WIDTH, HEIGHT)
    annotate(overlay, optics, {}, [] if stage.ground is None else [NO_FLOOR])
    places = {name: pose[:3] for name, pose in moment.poses.items()}
    places |= {name: read.position for name, read in moment.read.items()}
    for course in shown.courses:
        draw_part(overlay, optics, course, places)
    for read in moment.read.values():
        draw_reading(overlay, optics, read.position)
    named = named_corners(stage.model, stage.boxes(moment.poses), [body.name for body in shown.bodies if body.pose])
    tops = {shown.labels.get(name, name): _top(box_of(optics.places(corners))) for name, corners in named.items()}
    for read in moment.read.values():
        ((x, y),) = optics.places(np.array([read.position])).tolist()
        tops[read.words] = (x, y - RING)
    _label(overlay, tops)
    _write(overlay, moment)
    return overlay


def _top(box: tuple[float, float, float, float]) -> Place:
    return (box[0] + box[2]) / 2, box[1]


def _label(overlay: Overlay, tops: Mapping[str, Place]) -> None:
    """Write texts above positions, starting with the lowest.

    A text that would cover another, or lies outside the image, is omitted.
    """
    taken: list[tuple[float, float, float]] = []
    for text, (x, y) in sorted(tops.items(), key=lambda item: -item[1][1]):
        # A comparison with NaN is false, so what lies behind the camera is outside too.
        if not (0 <= x <= WIDTH and 0 <= y <= HEIGHT):
            continue
        half = overlay.width(text) / 2 + PAD
        middle, top = min(max(x, half), WIDTH - half), max(y - LINE - 8, 0.0)
        if any(abs(middle - other) < half + width and abs(top - height) < LINE for other, height, width in taken):
            continue
        taken.append((middle, top, half))
        overlay.box((middle - half, top), (middle + half, top + LINE), 7, PAPER, 0.7)
        overlay.text(text, middle - half + PAD, top, INK)


def _write(overlay: Overlay, moment: Moment) -> None:
    """Write the captions and the clock below the image."""
    clock = WIDTH - _EDGE - overlay.width(moment.clock)
    overlay.text(moment.clock, clock, HEIGHT + _STRIP - LINE - 6, INK)
    for row, text in enumerate(moment.captions[:_ROWS]):
        room = (clock if row == _ROWS - 1 else WIDTH) - 2 * _EDGE
        overlay.text(_shortened(overlay, text, room), _EDGE, HEIGHT + 6 + row * (LINE + 6), SOFT if row == 0 else INK)


def _shortened(overlay: Overlay, text: str, room: float) -> str:
    if overlay.width(text) <= room:
        return text
    while text and overlay.width(f"{text}…") > room:
        text = text[:-1]
    return f"{text}…"
