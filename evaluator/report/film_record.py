"""The record of a film, serialised as a script that consists of one call of `physmentFilm` with the record.

Browsers let a page that was opened from disk load scripts but not fetch files, so a film is a script. Run folders are
untrusted, and a foreign script could run any code in the page. A report therefore never copies the script: it parses
the record and serialises it again.
"""

import base64
import binascii
import json
import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from evaluator.records.episode import Record, is_absent

MOST_BYTES = 16_000_000
"""Largest size of a film [bytes]."""
MOST_NUMBERS = 16_000_000
"""Largest number of values in a film: one time for each instant, and seven values for each body at each instant."""
MOST_PARTS, MOST_COURSES = 500, 100
"""Largest number of shapes that a film ever draws, and of cords, springs, rods, rails and pulleys of a drawing."""
FARTHEST_M = 1e10
"""Largest length and coordinate [m]: what the engine accepts."""

_BEGIN, _END = b"physmentFilm(", b");\n"
_Share = Annotated[float, Field(ge=0, le=1)]
_Length = Annotated[float, Field(ge=0, le=FARTHEST_M)]
_Coordinate = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
_Place = tuple[_Coordinate, _Coordinate, _Coordinate]
_Quaternion = tuple[float, float, float, float]
_Index = Annotated[int, Field(ge=0)]
_Step = Annotated[float, Field(gt=0)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
_Title = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,100}$")]
_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "plane": 0}
"""Shape → number of its sizes that must be positive."""


class DrawnPart(Record):
    """A shape of a body, with its pose in the frame of the body."""

    shape: Literal["sphere", "box", "capsule", "cylinder", "ellipsoid", "plane"]
    size: tuple[_Length, _Length, _Length]
    """Radius and half lengths [m]; 0 for the endless directions of a plane."""
    pos: _Place
    quat: _Quaternion
    rgba: tuple[_Share, _Share, _Share, _Share]

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        if not all(self.size[: _SIZES[self.shape]]) or not math.isclose(math.hypot(*self.quat), 1, abs_tol=0.01):
            raise ValueError("a shape has no size or no orientation")
        return self


class DrawnBody(Record):
    """A visible body: an object, which has poses, or a fixture, which has none."""

    id: Annotated[str, Field(pattern=r"^([A-Za-z][A-Za-z0-9_-]{0,63}|fixture:[0-9]{1,6})$")]
    object: bool
    movable: bool
    parts: tuple[DrawnPart, ...]

    @model_validator(mode="after")
    def _is_named_by_its_kind(self) -> Self:
        if self.object == self.id.startswith("fixture:"):
            raise ValueError("a body has the id of another kind")
        return self


class DrawnCourse(Record):
    """A cord, spring, rod, rail or pulley that the task describes, and that is not a body of the model."""

    kind: Literal["cord", "spring", "rod", "rail", "pulley"]
    points: Annotated[tuple[_Name | _Place, ...], Field(min_length=1, max_length=100)]
    """Ends of the part: an object for its centre, or a position [m]."""


class Drawing(Record):
    """All bodies that are visible at the same time."""

    bodies: tuple[DrawnBody, ...]
    schematic: Annotated[tuple[DrawnCourse, ...], Field(max_length=MOST_COURSES)] = Field(
        default=(), exclude_if=is_absent
    )
    names: dict[_Name, _Title] = Field(default_factory=dict[str, str], max_length=MOST_PARTS, exclude_if=is_absent)
    """Object → its name in the prompt; absent in films of earlier versions."""


class PlaceRead(Record):
    """Position of an object as last returned by a call."""

    position: _Place
    angle: float | None = Field(default=None, exclude_if=lambda angle: angle is None)
    """About its joint [rad]; absent if it was not returned."""
    time: float


class Film(Record):
    """The poses of visible bodies over an episode. `evaluator.films.motion.reel` encodes `data`."""

    format: Literal[1] = 1
    episode: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """SHA-256 of the episode's line in its `episodes.jsonl`."""
    revealed: bool = Field(default=False, exclude_if=is_absent)
    """Whether the film also shows objects that the agent could not see; absent if not."""
    calls: tuple[tuple[_Index, ...], ...]
    """For each call of each turn, the index of the instant after it."""
    read: tuple[tuple[_Index, dict[_Name, PlaceRead]], ...] = Field(default=(), exclude_if=is_absent)
    """Number of a call over all turns → positions of undrawn objects as last read, from that call on."""
    drawings: tuple[Drawing, ...]
    cuts: tuple[tuple[_Index, _Index], ...]
    """Instants at which the drawing changes, with the index of the new drawing."""
    bodies: tuple[_Name, ...]
    """Objects whose poses `data` holds, in that order."""
    count: Annotated[int, Field(ge=1, le=MOST_NUMBERS)]
    """Number of instants."""
    step: _Step
    """Resolution of positions [m]."""
    turn: _Step
    """Resolution of the components of quaternions."""
    data: str
    """Encoded times and poses, as base64."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        faults = [*self._faults_of_size(), *self._faults_of_order(), *self._faults_of_things()]
        if faults:
            raise ValueError(faults[0])
        return self

    def _faults_of_size(self) -> Iterator[str]:
        if self.count * (1 + 7 * len(self.bodies)) > MOST_NUMBERS:
            yield f"it holds more than {MOST_NUMBERS} numbers"
        bodies = [body for drawing in self.drawings for body in drawing.bodies]
        shapes = {(body.id, number) for body in bodies for number in range(len(body.parts))}
        if len(shapes) > MOST_PARTS or any(len(read_all) > MOST_PARTS for _, read_all in self.read):
            yield f"it shows more than {MOST_PARTS} things"

    def _faults_of_order(self) -> Iterator[str]:
        if any(instant >= self.count for turn in self.calls for instant in turn):
            yield "a call returned after its end"
        if any(a > b for a, b in pairwise(instant for turn in self.calls for instant in turn)):
            yield "its calls are in no order"
        changes = [call for call, _ in self.read]
        if any(a >= b for a, b in pairwise([*changes, sum(map(len, self.calls))])):
            yield "its readings are in no order"
        instants = [instant for instant, _ in self.cuts]
        if instants[:1] != [0] or instants[-1] >= self.count or any(a >= b for a, b in pairwise(instants)):
            yield "its cuts are in no order"
        if any(drawing >= len(self.drawings) for _, drawing in self.cuts):
            yield "a cut shows a drawing that is not there"

    def _faults_of_things(self) -> Iterator[str]:
        drawn = [Counter(body.id for body in drawing.bodies) for drawing in self.drawings]
        objects = {body.id for drawing in self.drawings for body in drawing.bodies if body.object}
        if any(times > 1 for ids in (*drawn, Counter(self.bodies)) for times in ids.values()):
            yield "two of its bodies have one id"
        if objects != set(self.bodies):
            yield "what it draws and what it places are different objects"
        try:
            base64.b64decode(self.data, validate=True)
        except binascii.Error:
            yield "its numbers are no base64"


def written(film: Film) -> bytes:
    """Serialise a film as a script. The script is ASCII, so that it does not depend on the encoding of its page."""
    return _BEGIN + json.dumps(film.model_dump(mode="json"), separators=(",", ":")).encode("ascii") + _END


def read(script: bytes, episode: str) -> Film:
    """Parse the script of a film.

    Args:
        script: Content of the file.
        episode: Expected SHA-256 of the episode's line of `episodes.jsonl`.

    Raises:
        ValueError: The script does not have the format of `written`, or is the film of another record. The message
            quotes nothing from the script.
    """
    if len(script) > MOST_BYTES:
        raise ValueError(f"it has more than {MOST_BYTES} bytes")
    if not script.startswith(_BEGIN) or not script.endswith(_END):
        raise ValueError("it is not one call of physmentFilm")
    try:
        film = Film.model_validate_json(script[len(_BEGIN) : -len(_END)])
    except ValidationError as error:
        raise ValueError(
            f"it holds no film: {error.errors(include_url=False, include_input=False)[0]['msg']}"
        ) from None
    if film.episode != episode:
        raise ValueError("it shows another record of its episode")
    return film
