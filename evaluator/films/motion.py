"""The motion of a film: poses of bodies at its instants, and their encoding.

Motion is compressed: values are rounded to integers, and their second differences are stored with run lengths of zeros.
`viewer/src/reel.ts` decodes it in the browser.
"""

import base64
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.report.film_record import FARTHEST_M, Film

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
