"""Chooses the frames of the film in the README: what moves, and which lines are written below it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from evaluator.films.motion import Motion, decoded
from tests.harness.front_page.episode import Played, Story, signed, story

FRAME_S = 0.075
"""Wall time of a frame in which the carts move [s]."""
SLOWER = 1.5
"""Wall time of the film per simulated time, while the carts move."""
FILM_S = 6.0
"""Wall time of the film [s]; its last frame stays until then."""
_START_S, _ASKED_S, _READ_S = 0.5, 0.35, 0.6
"""Wall time before the first call, and of the frames after a question and after a reading [s]."""


class Line(NamedTuple):
    """The line of an iteration."""

    done: str
    """What the agent does."""
    read: str = ""
    """What it reads; empty before the laboratory has returned it."""


class Frame(NamedTuple):
    """One frame of the film."""

    poses: Mapping[str, Sequence[float]]
    """Object → position [m] and quaternion, 7 numbers."""
    time: float
    """Simulated time [s]."""
    lines: Sequence[Line]
    push: str
    """The force that acts on the red cart; empty if none acts."""
    mass: str
    """The mass of the blue cart, as far as the agent knows it."""
    duration_ms: int


def frames_of(played: Played) -> list[Frame]:
    """Return the frames, which last `FILM_S` together."""
    frames = list(_frames(story(played), decoded(played.film), [call for turn in played.film.calls for call in turn]))
    rest = round(1000 * FILM_S) - sum(frame.duration_ms for frame in frames[:-1])
    return [*frames[:-1], frames[-1]._replace(duration_ms=rest)]


def _frames(told: Story, motion: Motion, calls: Sequence[int]) -> Iterator[Frame]:
    pushed, collided, last = calls[1], calls[4], len(motion.times) - 1
    push = f"{told.push_n:g} N"
    first = Line(f"push red with {push} for {told.push_s:g} s", f"red {signed(told.before)} m/s")
    second = Line(f"wait {told.run_s:g} s: the carts collide", f"red {signed(told.red)}, blue {signed(told.blue)} m/s")
    change = f"1 kg × ({signed(told.before)} {'+' if told.red < 0 else '−'} {abs(told.red):.2f}) / {told.blue:.2f}"
    third = Line(f"answer: {change} = {told.answer:.2f} kg", told.verdict)

    def frame(position: float, lines: Sequence[Line], duration_s: float, push: str = "", mass: str = "?") -> Frame:
        time = float(np.interp(position, np.arange(last + 1), motion.times))
        return Frame(motion.at(position), time, lines, push, f"{mass} kg", round(1000 * duration_s))

    yield frame(0, [], _START_S)
    yield frame(0, [first._replace(read="")], _ASKED_S, push)
    for position in _positions(motion, 0, pushed):
        yield frame(position, [first._replace(read="")], FRAME_S, push)
    yield frame(pushed, [first], _READ_S)
    for position in _positions(motion, pushed, collided):
        yield frame(position, [first, second._replace(read="")], FRAME_S)
    yield frame(collided, [first, second], _READ_S)
    yield frame(last, [first, second, third], 0, mass=f"{told.answer:.2f}")


def _positions(motion: Motion, start: int, end: int) -> list[float]:
    """Return positions in the film at equal intervals of simulated time, between two instants."""
    times = motion.times[start : end + 1]
    wanted = np.arange(times[0], times[-1], FRAME_S / SLOWER)[1:]
    found: list[float] = np.interp(wanted, times, np.arange(start, end + 1)).tolist()
    return found
