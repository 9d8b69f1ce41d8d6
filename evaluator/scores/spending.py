"""What episodes cost: tokens, money, time. Pure; every number comes with how many episodes it speaks of.

Unscored episodes count too: what an infrastructure error ended was paid for all the same.
"""

import math
from collections.abc import Iterable, Sequence
from statistics import fmean, median
from typing import NamedTuple

from evaluator.records import Episode, Record, Turn, Verdict
from evaluator.scores.metrics import ScoredEpisode


class Quantiles(Record):
    """The middle and the upper end of some times."""

    n: int
    median: float
    """[s]."""
    p95: float
    """[s]; 95 % of the times are no longer."""


class Spending(Record):
    """Tokens, money and time of some episodes."""

    n: int
    """Episodes."""
    n_metered: int
    """Episodes that report tokens: the denominator of the means of tokens."""
    input_tokens: int
    output_tokens: int
    cached_tokens: int
    n_priced: int
    """Episodes with a price."""
    cost_usd: float | None
    """Sum [US$] over the priced ones; None without any."""
    cost_per_correct_usd: float | None
    """That sum over the priced episodes that are strictly correct [US$]; None without any."""
    iterations: float | None
    """Mean over episodes; so are calls."""
    calls: float | None
    agent_turn: Quantiles | None
    """Time the agent took for a turn."""
    server_turn: Quantiles | None
    """Time the laboratory took for the calls of a turn."""
    episode: Quantiles | None
    """Wall time of an episode."""


class _Paid(NamedTuple):
    usd: float
    correct: bool


def spending(rows: Sequence[ScoredEpisode]) -> Spending:
    """What some episodes cost."""
    usages = [row.episode.usage for row in rows if row.episode.usage is not None]
    paid = [
        _Paid(row.episode.usage.cost_usd, row.grade.strict is Verdict.CORRECT)
        for row in rows
        if row.episode.usage is not None and row.episode.usage.cost_usd is not None
    ]
    cost = math.fsum(one.usd for one in paid) if paid else None
    right = sum(one.correct for one in paid)
    turns = [turn for row in rows for turn in row.episode.turns]
    return Spending(
        n=len(rows),
        n_metered=len(usages),
        input_tokens=sum(one.input_tokens for one in usages),
        output_tokens=sum(one.output_tokens for one in usages),
        cached_tokens=sum(one.cached_tokens for one in usages),
        n_priced=len(paid),
        cost_usd=cost,
        cost_per_correct_usd=cost / right if cost is not None and right else None,
        iterations=_mean(len(row.episode.turns) for row in rows),
        calls=_mean(calls_made(row.episode.turns) for row in rows),
        agent_turn=_quantiles(turn.agent_s for turn in turns),
        server_turn=_quantiles(turn.server_s for turn in turns),
        episode=_quantiles(_wall_times(row.episode for row in rows)),
    )


def calls_made(turns: Sequence[Turn]) -> int:
    """How many calls the agent wrote."""
    return sum(len(turn.exchanges) for turn in turns)


def _wall_times(episodes: Iterable[Episode]) -> Iterable[float]:
    return (one.duration_s for one in episodes)


def _mean(counts: Iterable[int]) -> float | None:
    values = list(counts)
    return fmean(values) if values else None


def _quantiles(times: Iterable[float]) -> Quantiles | None:
    """Median and 95th percentile (nearest rank); None where nothing was timed, as in imported transcripts."""
    values = sorted(times)
    if not any(values):
        return None
    return Quantiles(n=len(values), median=median(values), p95=values[math.ceil(0.95 * len(values)) - 1])
