"""The current turn and the last call of a running episode, for displays."""

import time
from contextvars import ContextVar
from dataclasses import dataclass, field

from evaluator.records.episode import EpisodeKey


@dataclass(slots=True)
class Underway:
    """State of a running episode for displays. It changes during play and is not recorded."""

    key: EpisodeKey
    turn: int = 0
    """Number of the present turn, from 1; 0 before the first one, and if another process plays the episode."""
    call: str = ""
    """Name of the last tool that was called; empty before the first call."""
    began_at: float = field(default_factory=time.monotonic)
    """Time of its beginning on the monotonic clock [s]."""


UNDERWAY: ContextVar[Underway | None] = ContextVar("UNDERWAY", default=None)
"""The episode that the present task plays; None if no display needs it."""


def note_turn(number: int) -> None:
    """Record that a turn begins.

    Args:
        number: Number of the turn, from 1.
    """
    present = UNDERWAY.get()
    if present is not None:
        present.turn = number


def note_call(tool: str) -> None:
    """Record that a tool is called."""
    present = UNDERWAY.get()
    if present is not None:
        present.call = tool
