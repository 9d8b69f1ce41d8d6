"""Data that the browser page shows besides the episode: the participant of a challenge, and how an episode ended."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import JsonValue


@dataclass(frozen=True, slots=True)
class Ending:
    """How an episode ended, for the page. Exists only after the episode is over and graded."""

    sentence: str
    correct: bool | None = None
    """Whether the answer is right; None if nothing was recorded."""
    key: JsonValue = None
    """The answer key; None if nothing was recorded."""
    answer: JsonValue = None
    """The accepted answer; None without one."""
    report: Path | None = None
    """The report of the episode; None if nothing was recorded."""
    choices: Mapping[str, str] = field(default_factory=dict[str, str])
    """Choices for the next episode: `seed` and `scene` → name. Empty if there are none."""


@dataclass(slots=True)
class Visitor:
    """A person who takes part in a challenge, as the page shows it."""

    code: str
    """Pseudonym of the person in all records."""
    consent: str
    """One sentence that the person agrees to before the first episode."""
    ends_at: float | None = None
    """When the person's time ends, on the monotonic clock [s]; None before the consent, or without a limit."""
    agreed: bool = False
    minutes: float | None = None
    """Time from the consent on [min]; None without a limit."""
