"""Makes films: replays a stored episode, records its views, and encodes the motion. Raises if a result differs.

Motion is compressed: values are rounded to integers, and their second differences are stored with run lengths of zeros.
`viewer/src/reel.ts` decodes it in the browser.
"""

import base64
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from itertools import pairwise
from typing import Any, NamedTuple

import mcp_types as types
import numpy as np
from mcp import Client
from mcp.shared.exceptions import MCPError
from numpy.typing import NDArray
from pydantic import ValidationError

from evaluator.agents.recorded import exact_difference, play_again
from evaluator.episode.toolbox import Toolboxes, view_in, view_now
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.episode import Episode, EpisodeKey
from evaluator.report.film_record import FARTHEST_M, Film
from evaluator.study.forking import described
from physment_mcp.contract.last_read import Reading, read_after

Array = NDArray[np.float64]

TURN = 1 / 2048
"""Resolution of the components of quaternions, about 0.06 degrees."""
_FINEST_M, _OF_SCENE, _OF_PART = 1e-6, 1e-4, 1e-2
"""Resolution of positions: lower limit [m], and fractions of the extent of the scene and of its smallest part."""
_MICRO = 1e6
_LARGEST = 2**53
"""Largest magnitude of a decoded integer, up to which floats are exact."""


class Instant(NamedTuple):
    """Visible state at one moment of a film."""

    time: float
    """Simulated time [s]. Two instants may share it: one before and one after a call that takes no time."""
    drawing: int
    """Index of the drawing shown at this moment."""
    poses: Mapping[str, Sequence[float]]
    """Body → position x, y, z [m] and quaternion w, x, y, z."""


def reel(instants: Sequence[Instant], drawings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Encode the poses of all bodies over time, as fields of a film.

    Args:
        instants: The instants in order; at least one.
        drawings: The drawings, as the laboratory sends them.
    """
    bodies = list(dict.fromkeys(name for instant in instants for name in instant.poses))
    step = _step(instants, drawings)
    times = [round(_MICRO * instant.time) for instant in instants]
    data = bytearray(_course(times))
    for name in bodies:
        for column in _columns([instant.poses.get(name) for instant in instants], step):
            data += _course(column)
    cuts = [(0, instants[0].drawing)]
    cuts += [
        (k, after.drawing) for k, (before, after) in enumerate(pairwise(instants), 1) if after.drawing != before.drawing
    ]
    return {
        "drawings": list(drawings),
        "cuts": cuts,
        "bodies": bodies,
        "count": len(instants),
        "step": step,
        "turn": TURN,
        "data": base64.b64encode(data).decode("ascii"),
    }


def _step(instants: Sequence[Instant], drawings: Sequence[Mapping[str, Any]]) -> float:
    """Return the resolution of positions [m], a power of ten."""
    places = np.array([pose[:3] for instant in instants for pose in instant.poses.values()] or [[0.0, 0.0, 0.0]])
    sizes = [max(part["size"]) for drawing in drawings for body in drawing["bodies"] for part in body["parts"]]
    sizes = [size for size in sizes if size > 0] or [1.0]
    extent = float(np.linalg.norm(places.max(axis=0) - places.min(axis=0))) + min(sizes)
    finest = max(_FINEST_M, min(_OF_SCENE * extent, _OF_PART * min(sizes)))
    return float(f"1e{math.floor(math.log10(finest) + 1e-9)}")


def _columns(poses: Sequence[Sequence[float] | None], step: float) -> Iterator[list[int]]:
    """Yield the time series of a pose's seven components, in units of the resolution.

    While the body is not visible, they keep their last values.
    """
    first = next(pose for pose in poses if pose is not None)
    kept: list[Sequence[float]] = []
    last = first
    for pose in poses:
        # q and -q are the same orientation; choose the one nearer to the previous quaternion.
        if pose is not None:
            turned = sum(a * b for a, b in zip(pose[3:], last[3:], strict=True)) < 0
            last = [*pose[:3], *(-value for value in pose[3:])] if turned else pose
        kept.append(last)
    for axis in range(7):
        unit = step if axis < 3 else TURN
        yield [round(pose[axis] / unit) for pose in kept]


def _course(values: Sequence[int]) -> bytes:
    """Encode integers: second differences, zigzag, base 128. A 0 is followed by the number of further zeros."""
    data = bytearray()
    zeros = 0
    for value in (*_second_differences(values), None):
        if value == 0:
            zeros += 1
            continue
        if zeros:
            data += _base128((0, zeros - 1))
            zeros = 0
        if value is not None:
            data += _base128((value << 1 if value > 0 else (-value << 1) - 1,))
    return bytes(data)


def _second_differences(values: Iterable[int]) -> Iterator[int]:
    """Yield the difference of each value from the linear extrapolation of the two before it."""
    before, last = 0, 0
    for place, value in enumerate(values):
        yield value - (2 * last - before if place > 1 else last)
        before, last = last, value


def _base128(values: Iterable[int]) -> bytes:
    data = bytearray()
    for value in values:
        rest = value
        while rest > 127:
            data.append(rest & 127 | 128)
            rest >>= 7
        data.append(rest)
    return bytes(data)


class Motion(NamedTuple):
    """The decoded motion of a film."""

    times: Array
    """Simulated time of each instant (n,) [s]."""
    poses: Mapping[str, Array]
    """Body → position [m] and quaternion at each instant (n, 7)."""

    def at(self, position: float) -> dict[str, list[float]]:
        """Return the poses of all bodies at one moment.

        Args:
            position: Index of an instant, plus the fraction of the interval to the next one.
        """
        first = min(int(position), len(self.times) - 1)
        share, following = position - first, min(first + 1, len(self.times) - 1)
        found: dict[str, list[float]] = {}
        for name, poses in self.poses.items():
            pose = (1 - share) * poses[first] + share * poses[following]
            pose[3:] /= float(np.linalg.norm(pose[3:])) or 1.0
            found[name] = pose.tolist()
        return found


def decoded(film: Film) -> Motion:
    """Decode the motion of a film.

    Raises:
        ValueError: Its data are too short or too long, or a number is too large.
    """
    data = iter(base64.b64decode(film.data))
    try:
        times = np.array(_values(data, film.count)) / _MICRO
        units = np.array([film.step] * 3 + [film.turn] * 4)
        with np.errstate(over="ignore"):  # what is infinite is refused below
            poses = {name: units * np.array([_values(data, film.count) for _ in range(7)]).T for name in film.bodies}
    except StopIteration:
        raise ValueError("its motion ends too early") from None
    if next(data, None) is not None:
        raise ValueError("its motion has too many numbers")
    if any(not np.all(np.abs(found) <= FARTHEST_M) for found in (times, *poses.values())):
        raise ValueError("its motion leads too far")
    return Motion(times, poses)


def _values(data: Iterator[int], count: int) -> list[int]:
    """Decode the next sequence of integers."""
    values: list[int] = []
    before = last = zeros = 0
    for place in range(count):
        difference = 0
        if zeros:
            zeros -= 1
        elif (written := _next_base128(data)) == 0:
            zeros = _next_base128(data)
        else:
            difference = -(written + 1) // 2 if written % 2 else written // 2
        before, last = last, difference + (2 * last - before if place > 1 else last)
        if abs(last) > _LARGEST:
            raise ValueError("its motion has too large a number")
        values.append(last)
    return values


def _next_base128(data: Iterator[int]) -> int:
    value = shift = 0
    while True:
        byte = next(data)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value
        if value > 4 * _LARGEST:
            raise ValueError("its motion has too large a number")


Opens = Callable[[EpisodeKey], AbstractAsyncContextManager[Client]]
"""Function that opens the laboratory of an episode for a client that receives views (`_meta` of results)."""


async def film_of(episode: Episode, opens: Opens, record_sha256: str, *, revealed: bool) -> Film:
    """Make the film of a stored episode.

    Args:
        episode: The stored episode.
        opens: Function that opens the laboratory of the episode.
        record_sha256: SHA-256 of the episode's line of `episodes.jsonl`; the film contains it.
        revealed: Whether the laboratory also shows what the agent could not see.

    Raises:
        UsageError: A result of the laboratory differs from the stored one, or the film would be too large.
    """
    camera = _Camera()
    now, problem = None, ""
    async with opens(episode.key) as client:
        try:
            camera.see(await view_now(client))
            now = await play_again(episode, client, Toolboxes(look=camera.look))
        except (InfrastructureError, MCPError) as error:
            # Raised after the block, because the client's task group would wrap it in an exception group.
            problem = str(error)
    if now is None:
        raise UsageError(f"{described(episode.key)} cannot be played again: {problem}")
    _refuse_other_returns(episode, now)
    looks = iter(camera.looks)
    instant = 0
    calls = [[instant := next(looks) if one.returned else instant for one in turn.exchanges] for turn in episode.turns]
    seen = reel(camera.instants, camera.drawings) | {"read": list(_changes(episode, camera.drawings))}
    try:
        return Film.model_validate({"episode": record_sha256, "revealed": revealed, "calls": calls, **seen})
    except ValidationError as error:
        raise UsageError(f"{described(episode.key)} gives no film: {error.errors()[0]['msg']}") from error


def _changes(episode: Episode, drawings: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, Mapping[str, Reading]]]:
    """Yield the last positions read of objects that are sometimes invisible, after each call that changed one."""
    always = set[str].intersection(*({body["id"] for body in drawing["bodies"]} for drawing in drawings))
    read: Mapping[str, Reading] = {}
    exchanges = (exchange for turn in episode.turns for exchange in turn.exchanges)
    for number, exchange in enumerate(exchanges):
        if not exchange.returned or exchange.is_error or exchange.content is None:
            continue
        before, read = read, read_after(read, exchange.call.tool, exchange.call.arguments, exchange.content)
        read = {name: reading for name, reading in read.items() if name not in always}
        if read != before:
            yield number, read


def _refuse_other_returns(stored: Episode, now: Episode) -> None:
    for turn, (before, after) in enumerate(itertools.zip_longest(stored.turns, now.turns), start=1):
        pairs = itertools.zip_longest(before.exchanges, after.exchanges if after else ())
        for number, (old, new) in enumerate(pairs, start=1):
            found = exact_difference(old, new) if new else ("", old.text, "nothing")
            if found is not None:
                _, was, returned = found
                raise UsageError(
                    f"{described(stored.key)}, turn {turn}, call {number} ({old.call.tool}): {was} is recorded, and the"
                    f" laboratory now returns {returned}"
                )


class _Camera:
    """Collects the instants of a film and its drawings, each drawing once."""

    def __init__(self) -> None:
        self.instants: list[Instant] = []
        self.drawings: list[Mapping[str, Any]] = []
        self.looks: list[int] = []
        """For each call, the index of the instant after it."""
        self._kept = 0
        """Number of leading instants that must be kept, because calls refer to them."""

    def look(self, result: types.CallToolResult) -> None:
        """Add the instants of a call's result."""
        self.see(view_in(result))
        self.looks.append(len(self.instants) - 1)

    def see(self, view: Mapping[str, Any] | None) -> None:
        """Add the instants of a view: those of the motion that it contains, then its present state."""
        if view is None:
            return
        self._kept = len(self.instants)
        drawing = self._drawing(view["drawing"])
        motion: Mapping[str, Any] = view.get("motion") or {"times": (), "poses": {}}
        courses: Mapping[str, Sequence[Sequence[float]]] = motion["poses"]
        for place, time in enumerate(motion["times"]):
            self._add(time, drawing, view["poses"] | {name: course[place] for name, course in courses.items()})
        self._add(view["time"], drawing, view["poses"])

    def _drawing(self, drawing: Mapping[str, Any]) -> int:
        if drawing not in self.drawings:
            self.drawings.append(drawing)
        return self.drawings.index(drawing)

    def _add(self, time: float, drawing: int, poses: Mapping[str, Sequence[float]]) -> None:
        instant = Instant(time, drawing, poses)
        if self.instants and self.instants[-1] == instant:
            return
        # Of a period without motion, keep only the first and the last instant.
        last = self.instants[max(self._kept - 1, 0) :][-2:]
        still = len(last) == 2 and all(one.drawing == drawing and one.poses == poses for one in last)
        if still and len(self.instants) > self._kept:
            self.instants[-1] = instant
        else:
            self.instants.append(instant)
