"""How providers are asked: how many requests run at a time, which pauses are made, how long a reply may take."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import anyio

DEFAULT_LIMIT = 8
"""Most requests to one provider at a time, unless the operator sets another limit."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long one turn of a model is waited for."""

    timeout_s: float = 600.0
    """Longest duration of one request, to the last byte of its reply [s]."""
    attempts: int = 6
    """Requests made before the turn counts as failed."""
    first_pause_s: float = 1.0
    """Pause before the second attempt [s]; it doubles for each further attempt."""
    longest_pause_s: float = 60.0
    """Longest pause by doubling [s]; a provider may ask for a longer one."""
    total_wait_s: float = 900.0
    """Most pauses together [s]."""


@dataclass(slots=True)
class Lane:
    """The limits that all requests to one provider share."""

    limit: int = DEFAULT_LIMIT
    shut_until: float = -math.inf
    """No request starts before this time, on the clock of `Requests` [s]."""
    _limiter: anyio.CapacityLimiter | None = field(default=None, repr=False)

    @property
    def limiter(self) -> anyio.CapacityLimiter:
        """Limits the requests at a time. Made at first use, since it belongs to an event loop."""
        if self._limiter is None:
            self._limiter = anyio.CapacityLimiter(self.limit)
        return self._limiter


@dataclass(slots=True)
class Lanes:
    """The lanes of a run. Agents of the same provider share a lane."""

    limits: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → most requests at a time."""
    default: int = DEFAULT_LIMIT
    _lanes: dict[str, Lane] = field(default_factory=dict[str, Lane], repr=False)

    def of(self, provider: str) -> Lane:
        """The lane of a provider, made when first asked for."""
        return self._lanes.setdefault(provider, Lane(self.limits.get(provider, self.default)))
