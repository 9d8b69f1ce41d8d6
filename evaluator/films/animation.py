"""Chooses the frames of an animated image from the film of an episode."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from evaluator.certify.moving_pictures import Moment, Shown, ShownBody, ShownPart, ShownReading, SketchedPart, label_of
from evaluator.films.motion import Motion, decoded
from evaluator.records.episode import Episode
from evaluator.report.call_rows import CallRow, calls_of
from evaluator.report.film_record import Drawing, Film, PlaceRead

MOST_FRAMES = 180
"""Largest number of frames of an animation."""
_FRAME_S = 0.08
"""Wall time of a frame in which things move [s]."""
_LONGEST_S, _SHORTEST_S = 12.0, 2.0
"""Range of the total wall time of all motion [s]; the speed, a power of two, may make it leave this range."""
_READ_S, _READ_ALL_S = 0.8, 20.0
"""Wall time for which one result is shown, and upper limit for all results together [s]."""
_FIRST_S, _LAST_S = 1.0, 2.5
"""Wall time of the first and of the last frame [s]."""


class Animation(NamedTuple):
    """The content of an animated image of an episode."""

    things: Sequence[Shown]
    moments: Sequence[Moment]


class _Call(NamedTuple):
    turn: int
    row: CallRow
    start: int
    """Instant before the call."""
    end: int
    """Instant after the call."""


def animation_of(film: Film, episode: Episode, title: str) -> Animation:
    """Choose at most `MOST_FRAMES` frames: every call, and the motion while time passes.

    Args:
        film: The film of the episode.
        episode: Its record.
        title: The first line below the image.

    Raises:
        ValueError: The film is damaged, or shows other calls than the episode has.
    """
    if [*map(len, film.calls)] != [len(turn.exchanges) for turn in episode.turns]:
        raise ValueError("its film shows other calls")
    things = [_shown(drawing) for drawing in film.drawings]
    moments = list(_Frames(film, decoded(film), episode, title).moments())
    return Animation(things, _thinned(moments, MOST_FRAMES))


def _shown(drawing: Drawing) -> Shown:
    bodies = [
        ShownBody(
            body.id,
            body.movable,
            (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if body.object else (),
            [ShownPart(one.shape, [*one.size], [*one.pos], [*one.quat], [*one.rgba]) for one in body.parts],
        )
        for body in drawing.bodies
    ]
    labels = {body.id: _label(drawing, body.id) for body in drawing.bodies}
    return Shown(bodies, [SketchedPart(course.kind, course.points) for course in drawing.schematic], labels)


def _label(drawing: Drawing, object_id: str) -> str:
    return label_of(object_id, drawing.names.get(object_id, object_id))


class _Frames:
    def __init__(self, film: Film, motion: Motion, episode: Episode, title: str) -> None:
        self._film, self._motion, self._title = film, motion, title
        self._budget = episode.key.budget
        self._calls = list(_calls(film, episode))
        duration = sum(self._lasts(call) for call in self._calls)
        self._speed = _speed(duration)

    def moments(self) -> Iterator[Moment]:
        """Yield all frames before thinning, which may be more than `MOST_FRAMES`."""
        yield self._moment(0.0, 0, ["before the first call"], _FIRST_S)
        read_s = min(_READ_S, _READ_ALL_S / max(1, len(self._calls)))
        for made, call in enumerate(self._calls, start=1):
            asked = f"iteration {call.turn} of {self._budget}: {call.row.exchange.call.tool} {call.row.asked}".rstrip()
            for position in self._positions(call):
                yield self._moment(position, made - 1, [asked], _FRAME_S)
            is_last = made == len(self._calls)
            yield self._moment(float(call.end), made, [asked, _returned(call.row)], _LAST_S if is_last else read_s)

    def _lasts(self, call: _Call) -> float:
        """Return the simulated time that a call takes [s]; 0 if the call resets the clock."""
        return max(0.0, float(self._motion.times[call.end] - self._motion.times[call.start]))

    def _positions(self, call: _Call) -> Sequence[float]:
        """Return positions in the film at equal intervals of simulated time, from the start to the end of a call."""
        count = int(self._lasts(call) / self._speed / _FRAME_S)
        times: list[float] = self._motion.times[call.start : call.end + 1].tolist()
        wanted = [times[0] + (times[-1] - times[0]) * step / count for step in range(1, count)]
        return [float(np.interp(time, times, np.arange(call.start, call.end + 1))) for time in wanted]

    def _moment(self, position: float, made: int, captions: Sequence[str], duration_s: float) -> Moment:
        drawing = [number for instant, number in self._film.cuts if instant <= position][-1]
        drawn = {body.id for body in self._film.drawings[drawing].bodies}
        poses = {name: pose for name, pose in self._motion.at(position).items() if name in drawn}
        first = int(position)
        time = float(np.interp(position, [first, first + 1], self._motion.times[[first, min(first + 1, self._last)]]))
        clock = f"{time:.2f} s, {_factor(self._speed)}"
        return Moment(
            drawing, poses, self._read(made, drawing), [self._title, *captions], clock, round(1000 * duration_s)
        )

    @property
    def _last(self) -> int:
        return len(self._motion.times) - 1

    def _read(self, made: int, number: int) -> Mapping[str, ShownReading]:
        drawing = self._film.drawings[number]
        drawn = {body.id for body in drawing.bodies}
        found = [read for call, read in self._film.read if call < made][-1:]
        return {
            name: ShownReading(read.position, f"{_label(drawing, name)}, {_words(read)}")
            for read_all in found
            for name, read in read_all.items()
            if name not in drawn
        }


def _words(read: PlaceRead) -> str:
    return f"last read ({', '.join(f'{value:.4g}' for value in read.position)}) m at {read.time:.4g} s"


def _calls(film: Film, episode: Episode) -> Iterator[_Call]:
    start = 0
    for turn, (instants, played) in enumerate(zip(film.calls, calls_of(episode.turns), strict=True), start=1):
        for end, row in zip(instants, played.rows, strict=True):
            yield _Call(turn, row, start, end)
            start = end


def _returned(row: CallRow) -> str:
    values = [" ".join(filter(None, (one.name, one.value, one.unit))) for one in row.quantities]
    return ", ".join(values) or row.said


def _speed(duration: float) -> float:
    """Return the playback speed in simulated seconds per second of wall time, a power of two."""
    speed = 1.0
    while duration / speed > _LONGEST_S:
        speed *= 2
    while 0 < duration / speed < _SHORTEST_S:
        speed /= 2
    return speed


def _factor(speed: float) -> str:
    if speed == 1:
        return "real time"
    return f"{speed:g} times faster" if speed > 1 else f"{1 / speed:g} times slower"


def _thinned(moments: Sequence[Moment], most: int) -> list[Moment]:
    """Keep every n-th frame and the last one, at most `most`.

    The duration of a kept frame includes the durations of the omitted frames before it.
    """
    every = -(-len(moments) // most)
    kept: list[Moment] = []
    for _, group in groupby(enumerate(reversed(moments)), key=lambda item: item[0] // every):
        those = [moment for _, moment in group]
        kept.append(those[0]._replace(duration_ms=sum(moment.duration_ms for moment in those)))
    return kept[::-1]
