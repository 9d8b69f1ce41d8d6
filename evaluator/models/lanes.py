"""How providers are asked: the requests that may run at once, the pauses, and how long a reply is waited for."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import anyio

DEFAULT_LIMIT = 8
"""Requests under way at one provider where nobody says otherwise."""


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


@dataclass(slots=True)
class Lane:
    """What the requests to one provider share."""

    limit: int = DEFAULT_LIMIT
    shut_until: float = -math.inf
    """On the clock of the requests [s]: no request may start before it."""
    _limiter: anyio.CapacityLimiter | None = field(default=None, repr=False)

    @property
    def limiter(self) -> anyio.CapacityLimiter:
        """The places in the lane; made at first use, since only an event loop can have them."""
        if self._limiter is None:
            self._limiter = anyio.CapacityLimiter(self.limit)
        return self._limiter


@dataclass(slots=True)
class Lanes:
    """The lanes of a run, made as they are asked for, so that agents of one provider share one."""

    limits: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → requests under way."""
    default: int = DEFAULT_LIMIT
    _lanes: dict[str, Lane] = field(default_factory=dict[str, Lane], repr=False)

    def of(self, provider: str) -> Lane:
        """The lane of a provider."""
        return self._lanes.setdefault(provider, Lane(self.limits.get(provider, self.default)))
