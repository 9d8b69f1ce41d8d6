"""Replays the calls of a stored episode with chosen hidden values, and reads without rounding and noise.

Each reading has derivatives with respect to the instrument errors. They give the standard deviation of the reading and
the covariance of all readings at one moment, also for quantities that a tool derives from several readings.
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.answers.engine import READING_TOOLS, session_of
from evaluator.records.episode import Episode
from physment_mcp.errors import RefusedCall
from physment_mcp.instruments import readout_of
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from physment_mcp.tools.edit import FIND_OBJECTS
from physment_mcp.world.readout import Quantity, Readout
from scenes import PackFiles

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Source = tuple[Quantity, str, int]
"""Source of an instrument error: the quantity, the identifier of the measured object, the number of the time step."""
Error = tuple[Source, int]
"""One component of the error of a source."""

_CLOCKS = frozenset({"sim_time", "lab_time_left", "calls_left", "steps"})
"""Fields that hold times or counters and no information about the scene."""
_SMALL = 1e-3
"""Step of numerical derivatives by an error, in standard deviations. It is small because energies are nonlinear."""
_READING = frozenset(tool.name for tool in READING_TOOLS)


class NotMeasurable(Exception):
    """The evidence of an episode cannot be computed; the message says why."""


@dataclass(frozen=True, slots=True)
class Probe(Readout):
    """Instruments without rounding and noise that record what was read and add chosen errors to readings.

    Systematic errors are hidden constants of the model, so they remain.
    """

    asked: dict[Source, int] = field(default_factory=dict[Source, int])
    """Each source that was read → number of its components."""
    errors: dict[Source, Array] = field(default_factory=dict[Source, Array])
    """Source → error that is added to its readings; other sources are read exactly."""

    def noise(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """Return the chosen error of a reading; see `Readout.noise`."""
        self.asked[quantity, source, step] = count
        return self.errors.get((quantity, source, step), np.zeros(count))

    def rounded(self, quantity: Quantity, value: Array) -> Array:
        """Return the value unrounded. `sigma` includes the rounding error."""
        del quantity
        return value

    def on_grid(self, place: Array) -> Array:
        """Round a target position as in the original episode."""
        return Readout(self.fineness, self.seed).rounded("position", place)

    def sigma(self, quantity: Quantity) -> float:
        """Standard deviation of one component, from the noise and the uniformly distributed rounding error."""
        fine = self.fineness.get(quantity)
        return 0.0 if fine is None else float(np.hypot(fine.noise, fine.resolution / np.sqrt(12)))


class Read(NamedTuple):
    """The numbers that a call returned, with their derivatives with respect to the instrument errors."""

    place: int
    """Number of the call in the episode, from 0."""
    time: float
    """Simulated time of the call [s]."""
    values: Array
    """Numbers in the result."""
    slopes: Mapping[Error, Array]
    """Instrument error → change of the values per standard deviation of the error."""


class Replay:
    """A laboratory with chosen hidden values, whose instruments neither round nor add noise."""

    def __init__(self, files: PackFiles, mjcf: str) -> None:
        """Open a laboratory with the given model.

        Args:
            files: The pack of the scene.
            mjcf: MuJoCo XML with chosen hidden values.
        """
        self._session = session_of(files, mjcf, any_calls=True)
        public = readout_of(self._session.scene.public)
        self._probe = Probe(public.fineness, public.seed, public.admitted)
        self._session.world.read_with(self._probe)

    def read(self, place: int, tool: str, arguments: Mapping[str, Any], *, slopes: bool) -> Read | None:
        """Run a call and return its reading.

        Args:
            place: Number of the call in the episode, from 0.
            tool: Name of the tool.
            arguments: Its arguments.
            slopes: Whether to compute derivatives with respect to the instrument errors.

        Returns:
            The numbers that the call returned; None for a call without a reading.

        Raises:
            NotMeasurable: The call is refused.
        """
        self._probe.asked.clear()
        try:
            result = call(self._session, tool, dict(arguments)).model_dump()
        except RefusedCall as refusal:
            raise NotMeasurable(f"{tool} was accepted in the episode and is refused in a replay: {refusal}") from None
        again = _again(self._session, tool, dict(arguments), result)
        if again is None:
            return None
        by_error = _slopes(self._probe, again) if slopes else {}
        return Read(place, self._session.world.time, _array(result), by_error)

    @contextmanager
    def branch(self) -> Generator[None]:
        """Restore the state of the laboratory at the end of the block, which undoes the calls made in it."""
        world, state = self._session.world.save(), self._session.state
        try:
            yield
        finally:
            self._session.world.restore(world)
            self._session.state = state


def replayed(files: PackFiles, mjcf: str, episode: Episode, *, slopes: bool) -> list[Read]:
    """Replay the calls of an episode in a model.

    Args:
        files: The pack of the scene.
        mjcf: MuJoCo XML with chosen hidden values.
        episode: The stored episode.
        slopes: Whether to compute derivatives with respect to the instrument errors.

    Raises:
        NotMeasurable: The replay refuses a call that the laboratory accepted.
    """
    replay = Replay(files, mjcf)
    calls = (exchange.call for _, exchange in episode.accepted_calls())
    found = (replay.read(place, one.tool, one.arguments, slopes=slopes) for place, one in enumerate(calls))
    return [read for read in found if read is not None]


def _again(
    session: Session, tool: str, arguments: dict[str, Any], result: dict[str, Any]
) -> Callable[[], Array] | None:
    """Return a function that repeats the reading of a call at this moment; None for a call without a reading.

    `find_objects` reveals objects only once, so its values are read from the session.
    """
    if tool in _READING:
        return lambda: _array(call(session, tool, arguments).model_dump())
    if tool == FIND_OBJECTS.name:
        revealed = [str(item["object_id"]) for item in result["revealed"]]
        return lambda: _array([session.describe(session.find(object_id)) for object_id in revealed])
    return None


def _array(result: Any) -> Array:
    return np.array(list(numbers(result)))


def _slopes(probe: Probe, read: Callable[[], Array]) -> dict[Error, Array]:
    """Return the change of a reading per standard deviation of each instrument error."""
    found: dict[Error, Array] = {}
    for source, count in dict(probe.asked).items():
        sigma = probe.sigma(source[0])
        for component in range(count if sigma > 0 else 0):
            ends: list[Array] = []
            for by in (_SMALL, -_SMALL):
                probe.errors[source] = by * sigma * np.eye(count)[component]
                ends.append(read())
            del probe.errors[source]
            found[source, component] = (ends[0] - ends[1]) / (2 * _SMALL)
    return found


def numbers(value: Any) -> Iterator[float]:
    """Yield the numbers in a result in order, without clocks and booleans."""
    if isinstance(value, Mapping):
        for name, part in value.items():  # pyright: ignore[reportUnknownVariableType]
            if name not in _CLOCKS:
                yield from numbers(part)
    elif isinstance(value, list | tuple):
        for part in value:  # pyright: ignore[reportUnknownVariableType]
            yield from numbers(part)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def joined(reads: Sequence[Read]) -> Array:
    """Concatenate the values of several calls."""
    return np.concatenate([read.values for read in reads]) if reads else np.zeros(0)
