"""What a run has used so far, and its limits: cost, tokens and wall time."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from evaluator.records.episode import Usage


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits on the cost, tokens and wall time of a run; None for no limit."""

    cost_usd: float | None = None
    tokens: int | None = None
    """Input and output tokens together."""
    wall_s: float | None = None
    """Wall time since this process started to play [s]."""


@dataclass(slots=True)
class Meter:
    """Adds up the cost, tokens and wall time of a run.

    In a resumed run, cost and tokens include those of earlier starts; wall time does not.
    """

    limits: Limits = Limits()
    clock: Callable[[], float] = time.monotonic
    cost_usd: float = 0.0
    tokens: int = 0
    unpriced: int = 0
    """Number of tokens with an unknown price."""
    started: float = field(init=False)

    def __post_init__(self) -> None:
        self.started = self.clock()

    def add_all(self, usages: Iterable[Usage | None]) -> None:
        """Add the usage of several episodes."""
        for usage in usages:
            self.add(usage)

    def add(self, usage: Usage | None) -> None:
        """Add the usage of an episode; None adds nothing."""
        if usage is None:
            return
        used = usage.input_tokens + usage.output_tokens
        self.tokens += used
        if usage.cost_usd is None:
            self.unpriced += used
        else:
            self.cost_usd += usage.cost_usd

    @property
    def elapsed_s(self) -> float:
        """Wall time so far [s]."""
        return self.clock() - self.started

    def reached(self) -> str:
        """The limit that is reached, as a clause; empty if none is."""
        limits = self.limits
        if limits.cost_usd is not None and self.unpriced:
            return "--max-cost cannot be kept: the price of a model is not known"
        if limits.cost_usd is not None and self.cost_usd >= limits.cost_usd:
            return f"--max-cost is reached: ${self.cost_usd:.2f} of ${limits.cost_usd:.2f}"
        if limits.tokens is not None and self.tokens >= limits.tokens:
            return f"--max-tokens is reached: {self.tokens} of {limits.tokens}"
        if limits.wall_s is not None and self.elapsed_s >= limits.wall_s:
            return f"--max-time is reached: {self.elapsed_s:.0f} s of {limits.wall_s:.0f} s"
        return ""
