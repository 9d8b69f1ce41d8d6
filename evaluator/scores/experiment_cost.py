"""What the experiments of an episode cost in the laboratory: calls and simulated time. Pure.

A second efficiency beside E, which counts iterations: an iteration may hold any number of calls.
"""

import math
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any, TypeGuard

from evaluator.records.episode import Episode, Exchange, Record
from scenes import LabLimits


class ExperimentCost(Record):
    """What the experiments of one episode cost."""

    calls: int
    """Calls that the laboratory received, refused ones too; `answer` is not counted."""
    refused_calls: int
    """Those of them that it refused."""
    lab_time_s: float
    """Simulated time that passed in all steps [s]."""
    calls_of_limit: float | None
    """Calls as a share of the scene's limit, 0 to 1; None if it has none."""
    lab_time_of_limit: float | None
    """Lab time as a share of the scene's limit, 0 to 1; None if it has none."""


class MedianCost(Record):
    """What the experiments of a group of episodes cost: medians over episodes; None if there are none."""

    calls: float | None
    """Calls that the laboratory received, refused ones too; `answer` is not counted."""
    refused_calls: float | None
    """Those of them that it refused."""
    lab_time_s: float | None
    """Simulated time that passed in all steps [s]."""
    calls_of_limit: float | None
    """Calls as a share of the scene's limit, over the episodes whose scene has one."""
    n_calls_limited: int
    """Number of those episodes."""
    lab_time_of_limit: float | None
    """Lab time as a share of the scene's limit, over the episodes whose scene has one."""
    n_lab_time_limited: int
    """Number of those episodes."""


def cost_of(episode: Episode, limits: LabLimits) -> ExperimentCost:
    """What the experiments of an episode cost.

    Args:
        episode: As recorded.
        limits: Limits of its scene.
    """
    received = [exchange for turn in episode.turns for exchange in turn.exchanges if exchange.returned]
    counted = [exchange for exchange in received if exchange.call.tool != "answer"]
    lab_time_s = _lab_time_s(counted)
    return ExperimentCost(
        calls=len(counted),
        refused_calls=sum(exchange.is_error for exchange in counted),
        lab_time_s=lab_time_s,
        calls_of_limit=_share(len(counted), limits.calls),
        lab_time_of_limit=_share(lab_time_s, limits.lab_time),
    )


def _share(used: float, limit: float | None) -> float | None:
    """What was used of a limit; calls beyond it, which are refused, use no more."""
    return None if limit is None else min(1.0, used / limit)


def median_cost(costs: Sequence[ExperimentCost]) -> MedianCost:
    """What the experiments of a group of episodes cost."""
    of_calls = [found.calls_of_limit for found in costs if found.calls_of_limit is not None]
    of_lab_time = [found.lab_time_of_limit for found in costs if found.lab_time_of_limit is not None]
    return MedianCost(
        calls=_median([found.calls for found in costs]),
        refused_calls=_median([found.refused_calls for found in costs]),
        lab_time_s=_median([found.lab_time_s for found in costs]),
        calls_of_limit=_median(of_calls),
        n_calls_limited=len(of_calls),
        lab_time_of_limit=_median(of_lab_time),
        n_lab_time_limited=len(of_lab_time),
    )


def _median(values: Sequence[float]) -> float | None:
    return float(median(values)) if values else None


def _lab_time_s(exchanges: Iterable[Exchange]) -> float:
    clock, passed = 0.0, list[float]()
    for exchange in exchanges:
        before, clock = clock, lab_clock(exchange, clock)
        if exchange.call.tool == "step":
            passed.append(max(0.0, clock - before))
    return round(math.fsum(passed), 9)  # recorded times carry rounding errors


def lab_clock(exchange: Exchange, before: float) -> float:
    """Simulated time after a call [s]: as returned, or else the time before it plus the duration of a step.

    Args:
        exchange: The call with its return.
        before: Simulated time before the call [s].
    """
    content = exchange.content
    if exchange.is_error or content is None:
        return before
    for name in ("sim_time", "time"):
        time = content.get(name)
        if is_number(time):
            return float(time)
    duration = exchange.call.arguments.get("duration")
    return before + float(duration) if exchange.call.tool == "step" and is_number(duration) else before


def is_number(value: Any) -> TypeGuard[int | float]:
    """Whether a returned value can be a measured one: a finite number of ordinary size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) < 1e9
