"""Limits on requests to a provider: concurrency, retries, backoff and time-outs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import anyio

DEFAULT_LIMIT = 8
"""Default limit on concurrent requests to one provider."""


@dataclass(frozen=True, slots=True)
class Patience:
    """Retry and time-out settings for one turn of a model."""

    timeout_s: float = 600.0
    """Longest duration of one request, to the last byte of its reply [s]."""
    attempts: int = 6
    """Largest number of requests before the turn fails."""
    first_pause_s: float = 1.0
    """Pause before the second attempt [s]; doubled for each further attempt."""
    longest_pause_s: float = 60.0
    """Upper limit of the doubled pause [s]; a provider may request a longer one."""
    total_wait_s: float = 900.0
    """Largest total of all pauses in a turn [s]."""


@dataclass(slots=True)
class Lane:
    """Rate limits shared by all requests to one provider."""

    limit: int = DEFAULT_LIMIT
    shut_until: float = -math.inf
    """No request starts before this time on the clock of `Requests` [s]."""
    _limiter: anyio.CapacityLimiter | None = field(default=None, repr=False)

    @property
    def limiter(self) -> anyio.CapacityLimiter:
        """Semaphore for concurrent requests. Created at first use, because it belongs to an event loop."""
        if self._limiter is None:
            self._limiter = anyio.CapacityLimiter(self.limit)
        return self._limiter


@dataclass(slots=True)
class Lanes:
    """The lanes of a run, one per provider. All agents of a provider share its lane."""

    limits: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → limit on concurrent requests."""
    default: int = DEFAULT_LIMIT
    _lanes: dict[str, Lane] = field(default_factory=dict[str, Lane], repr=False)

    def of(self, provider: str) -> Lane:
        """Return the lane of a provider, and create it if necessary."""
        return self._lanes.setdefault(provider, Lane(self.limits.get(provider, self.default)))
