"""The motion of a film as few bytes: whole numbers, second differences, runs of zeros. Knows no files and no episodes.

Positions are multiples of a step that nobody sees, quaternions of `TURN`. A body that keeps its velocity has second
differences of 0, one under a constant force small ones, so that most values take a byte or much less.
"""

import base64
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

TURN = 1 / 2048
"""Step of the components of quaternions: 0.06 degrees."""
_FINEST_M, _OF_SCENE, _OF_PART = 1e-6, 1e-4, 1e-2
"""Steps of positions: the finest, and shares of the extent of the scene and of its smallest part."""
_MICRO = 1e6


class Instant(NamedTuple):
    """What is seen at one moment of a film."""

    time: float
    """Simulated time [s]. Two instants may share it: one before and one after a call that takes no time."""
    drawing: int
    """Index of the drawing."""
    poses: Mapping[str, Sequence[float]]
    """Body → x, y, z [m] and w, x, y, z."""


def reel(instants: Sequence[Instant], drawings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The part of a film that says what is where at which time.

    Args:
        instants: In order; at least one.
        drawings: The shapes, as the laboratory sends them.
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
    """The step of positions [m], a power of ten."""
    places = np.array([pose[:3] for instant in instants for pose in instant.poses.values()] or [[0.0, 0.0, 0.0]])
    sizes = [max(part["size"]) for drawing in drawings for body in drawing["bodies"] for part in body["parts"]]
    sizes = [size for size in sizes if size > 0] or [1.0]
    extent = float(np.linalg.norm(places.max(axis=0) - places.min(axis=0))) + min(sizes)
    finest = max(_FINEST_M, min(_OF_SCENE * extent, _OF_PART * min(sizes)))
    return float(f"1e{math.floor(math.log10(finest) + 1e-9)}")


def _columns(poses: Sequence[Sequence[float] | None], step: float) -> Iterator[list[int]]:
    """The seven numbers of a body over time, in steps; where the body is not seen, they stay as they are."""
    first = next(pose for pose in poses if pose is not None)
    kept: list[Sequence[float]] = []
    last = first
    for pose in poses:
        # q and -q are the same orientation; the nearer one has the smaller differences.
        if pose is not None:
            turned = sum(a * b for a, b in zip(pose[3:], last[3:], strict=True)) < 0
            last = [*pose[:3], *(-value for value in pose[3:])] if turned else pose
        kept.append(last)
    for axis in range(7):
        unit = step if axis < 3 else TURN
        yield [round(pose[axis] / unit) for pose in kept]


def _course(values: Sequence[int]) -> bytes:
    """A sequence of whole numbers: second differences, zigzag, base 128; a 0 is followed by how many more follow it."""
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
    """Each value less the continuation of the two before it."""
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
