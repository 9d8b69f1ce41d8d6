"""Converts between controls and calls: builds the calls of a leg, and extracts time series from calls and readings.

Used by reference protocols. A leg is an interval of constant controls; a `Course` is a sequence of legs.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.course_record import Channel, Course, recorded
from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading, call

TICK_S = 0.005
"""Time step of the scenes [s]; durations are multiples of it."""


def motion(duration: float, body: str = "object_1") -> list[Call]:
    """Return calls that wait [s] and read position and velocity of a body."""
    reads = (call(tool, object_id=body) for tool in ("get_position", "get_velocity"))
    return [call("step", duration=duration), *reads]


def lasting(calls: Sequence[Call]) -> float:
    """Return the simulated time that the calls take [s]."""
    return sum(float(asked.arguments["duration"]) for asked in calls if asked.tool == "step")


@dataclass(frozen=True, slots=True)
class Rig:
    """The controls that each leg sets, and the quantities that it reads."""

    controls: Sequence[Channel]
    """Components of forces and torques; each is set at the start of a leg."""
    readings: Sequence[Channel]
    """The readings after each look, in this order; channels of one call are read together."""
    decimals: int = 4
    """Number of decimals to which forces and torques are rounded."""
    significant: int | None = None
    """Number of significant digits to which they are rounded instead; None to use `decimals`."""

    def leg(self, pushes: Any, duration: float, looks: int = 1) -> list[Call]:
        """Return calls that apply constant pushes for a duration and read after each of its equal parts.

        Args:
            pushes: A value for each control [N, N·m]; missing values are 0.
            duration: Duration of the pushes [s]; each part is rounded to whole time steps, at least one.
            looks: Number of parts.
        """
        return [*self._set(pushes), *(self._look(duration / looks) * looks)]

    def along(self, pushes: Any, moments: Iterable[float]) -> list[Call]:
        """Return calls that apply constant pushes and read at these times [s]; intervals are whole time steps."""
        calls, before = self._set(pushes), 0.0
        for moment in moments:
            look = self._look(moment - before)
            calls, before = calls + look, before + look[0].arguments["duration"]
        return calls

    def _set(self, pushes: Any) -> list[Call]:
        given = np.atleast_1d(np.asarray(pushes, dtype=float)).tolist()
        vectors: dict[tuple[str, str, str], list[float]] = {}
        for number, channel in enumerate(self.controls):
            vector = vectors.setdefault((channel.tool, channel.object_id, channel.field), [0.0, 0.0, 0.0])
            vector[channel.axis or 0] = self._rounded(given[number]) if number < len(given) else 0.0
        return [call(tool, object_id=body, **{name: vector}) for (tool, body, name), vector in vectors.items()]

    def _look(self, duration: float) -> list[Call]:
        eyes = dict.fromkeys((channel.tool, channel.object_id) for channel in self.readings)
        waits = call("step", duration=max(round(duration / TICK_S), 1) * TICK_S)
        return [waits, *(call(tool, object_id=body) for tool, body in eyes)]

    def touched(
        self, first: float, growth: float, duration: float, moved: Callable[[Array], bool]
    ) -> Generator[list[Call], list[Reading], tuple[list[tuple[Call, Reading]], float]]:
        """Push with the first control, each time `growth` times as hard, until a reading shows motion.

        Returns:
            The exchanges, and the push that caused the motion.
        """
        seen, push = list[tuple[Call, Reading]](), first
        while True:
            calls = self.leg(push, duration)
            seen += zip(calls, (yield calls), strict=True)
            if moved(self.course(seen).readings[-1]):
                return seen, push
            push *= growth

    def _rounded(self, push: float) -> float:
        return round(push, self.decimals) if self.significant is None else float(f"{push:.{self.significant}g}")

    def course(self, exchanges: Exchanges) -> Course:
        """Extract the time series of controls and readings from calls and their results."""
        return recorded(exchanges, self.controls, self.readings)
