"""Time series of pushes and readings, extracted from the calls of an episode. Used by reference protocols.

A `Channel` selects a number in a call or its result, and `recorded` makes a `Course` from the calls of an episode.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading


@dataclass(frozen=True, slots=True)
class Channel:
    """A component of an applied force in the arguments of a call, or a reading in its result."""

    tool: str
    object_id: str
    field: str
    """Argument of the call, or field of its result."""
    axis: int | None = None
    """Index in a vector; None for a single number."""

    def of(self, values: Mapping[str, Any]) -> float:
        """Return the number in the arguments of a call or in its result."""
        value = values[self.field]
        return float(value if self.axis is None else value[self.axis])


@dataclass(frozen=True, slots=True)
class Course:
    """A time series of n legs: intervals with constant forces and torques, and readings at the end of each."""

    durations: Array
    """Simulated time of each leg [s]; shape (n,)."""
    controls: Array
    """Forces and torques held during each leg [N, N·m]; shape (n, controls)."""
    readings: Array
    """Readings at the end of each leg; shape (n, readings); NaN where nothing was read."""

    def until(self, caught: NDArray[np.bool_]) -> "Course":
        """Return the legs before the first marked one, for example before the leg in which a latch caught the body."""
        return self.first(int(np.argmax(caught)) if caught.any() else len(caught))

    @property
    def count(self) -> int:
        """Number of readings."""
        return int(np.count_nonzero(~np.isnan(self.readings)))

    def first(self, count: int) -> "Course":
        """Return the first `count` legs."""
        return Course(self.durations[:count], self.controls[:count], self.readings[:count])


def force(object_id: str, axis: int) -> Channel:
    """Component of the force applied to an object [N]."""
    return Channel("apply_force", object_id, "force_vector", axis)


def position(object_id: str, axis: int) -> Channel:
    """Coordinate of an object [m]."""
    return Channel("get_position", object_id, "position", axis)


def velocity(object_id: str, axis: int) -> Channel:
    """Component of the velocity of an object [m/s]."""
    return Channel("get_velocity", object_id, "velocity", axis)


def accepted(exchanges: Exchanges) -> Iterator[tuple[Call, Reading]]:
    """Yield the successful calls with their results."""
    return ((asked, reading) for asked, reading in exchanges if reading and "error" not in reading)


def recorded(exchanges: Exchanges, controls: Sequence[Channel], readings: Sequence[Channel]) -> Course:
    """Extract the pushes and readings from an episode's calls as a `Course`, without readings before the first step."""
    held, durations, forces, values = [0.0] * len(controls), list[float](), list[list[float]](), list[list[float]]()
    for request, result in accepted(exchanges):
        if request.tool == "step":
            durations.append(float(request.arguments["duration"]))
            forces.append(held)
            values.append([np.nan] * len(readings))
        held = _updated(held, controls, request.tool, request.arguments, request.arguments)
        if values:
            values[-1] = _updated(values[-1], readings, request.tool, request.arguments, result)
    return Course(np.array(durations), np.array(forces), np.array(values))


def _updated(
    before: list[float], channels: Sequence[Channel], tool: str, arguments: Mapping[str, Any], source: Reading
) -> list[float]:
    """Return the numbers of all channels after a call."""
    return [
        channel.of(source) if channel.tool == tool and channel.object_id == arguments.get("object_id") else number
        for channel, number in zip(channels, before, strict=True)
    ]
