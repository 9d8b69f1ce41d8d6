"""How long a model is waited for."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Patience:
    """Limits of one turn's asking."""

    timeout_s: float = 600.0
    """Longest duration of one request, to the last byte of its reply [s]."""
    attempts: int = 6
    """Requests made before the turn counts as failed."""
    first_pause_s: float = 1.0
    """Pause before the second attempt [s]; doubled for each further one."""
    longest_pause_s: float = 60.0
    """Where the doubling ends [s]; a provider that asks for more is given it."""
    total_wait_s: float = 900.0
    """Longest sum of pauses [s]."""
