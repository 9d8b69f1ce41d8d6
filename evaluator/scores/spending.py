"""Cost of episodes: tokens, money and time. Each value is given with its number of episodes.

Unscored episodes are included, because they cost money although they have no verdict.
"""

import math
from collections.abc import Iterable, Sequence
from statistics import fmean, median
from typing import NamedTuple

from evaluator.records.episode import Record, Turn
from evaluator.scores.scored_episode import ScoredEpisode


class Quantiles(Record):
    """Median and 95th percentile of a set of durations."""

    n: int
    """Number of durations."""
    median: float
    """[s]."""
    p95: float
    """[s]; 95 % of the durations are not longer."""


class Spending(Record):
    """Tokens, money and time of a group of episodes."""

    n: int
    """Episodes."""
    n_metered: int
    """Episodes that report tokens, which is the denominator of mean token counts."""
    input_tokens: int
    output_tokens: int
    cached_tokens: int
    n_priced: int
    """Episodes with a price."""
    cost_usd: float | None
    """Sum over the priced episodes [US$]; None if there are none."""
    cost_per_correct_usd: float | None
    """`cost_usd` divided by the number of priced episodes that are strictly correct [US$]; None if there are none."""
    iterations: float | None
    """Mean over episodes."""
    calls: float | None
    """Mean over episodes."""
    agent_turn: Quantiles | None
    """Agent time per turn."""
    server_turn: Quantiles | None
    """Server time for the calls of a turn."""
    episode: Quantiles | None
    """Wall time of an episode."""


class _Paid(NamedTuple):
    usd: float
    correct: bool


def spending(rows: Sequence[ScoredEpisode]) -> Spending:
    """Compute the cost of a group of episodes."""
    usages = [row.episode.usage for row in rows if row.episode.usage is not None]
    paid = [
        _Paid(row.episode.usage.cost_usd, row.is_correct)
        for row in rows
        if row.episode.usage is not None and row.episode.usage.cost_usd is not None
    ]
    cost = math.fsum(episode.usd for episode in paid) if paid else None
    correct = sum(episode.correct for episode in paid)
    turns = [turn for row in rows for turn in row.episode.turns]
    return Spending(
        n=len(rows),
        n_metered=len(usages),
        input_tokens=sum(usage.input_tokens for usage in usages),
        output_tokens=sum(usage.output_tokens for usage in usages),
        cached_tokens=sum(usage.cached_tokens for usage in usages),
        n_priced=len(paid),
        cost_usd=cost,
        cost_per_correct_usd=cost / correct if cost is not None and correct else None,
        iterations=_mean(len(row.episode.turns) for row in rows),
        calls=_mean(calls_made(row.episode.turns) for row in rows),
        agent_turn=_quantiles(turn.agent_s for turn in turns),
        server_turn=_quantiles(turn.server_s for turn in turns),
        episode=_quantiles(row.episode.duration_s for row in rows),
    )


def calls_made(turns: Sequence[Turn]) -> int:
    """Return the number of calls that the agent wrote."""
    return sum(len(turn.exchanges) for turn in turns)


def _mean(counts: Iterable[int]) -> float | None:
    values = list(counts)
    return fmean(values) if values else None


def _quantiles(durations: Iterable[float]) -> Quantiles | None:
    """Return median and 95th percentile (nearest rank); None if nothing was timed, as in imported transcripts."""
    values = sorted(durations)
    if not any(values):
        return None
    return Quantiles(n=len(values), median=median(values), p95=values[math.ceil(0.95 * len(values)) - 1])
