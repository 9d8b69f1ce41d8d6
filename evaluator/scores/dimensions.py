"""The six dimensions and the Final Score of one episode, and the cost of its experiments.

C: graded correctness. E: efficiency. G: grounding. V: share of valid calls. R: non-repetition. G′: held-out category
accuracy. G′ depends on the other categories of a run, so `evaluator.scores.metrics` computes it.

E counts iterations, and an iteration may hold any number of calls. The cost of experiments therefore counts calls and
simulated time as well.
"""

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any, TypeGuard

from evaluator.episode.player import ANSWER
from evaluator.records.episode import Episode, Exchange, Grade, Outcome, Record
from evaluator.scores.grounding import Grounding
from scenes import LabLimits


class ExperimentCost(Record):
    """Cost of the experiments of one episode."""

    calls: int
    """Calls that the server received, including refused calls but not `answer`."""
    refused_calls: int
    """Calls that the server refused."""
    lab_time_s: float
    """Total simulated time of all steps [s]."""
    calls_of_limit: float | None
    """Calls as a share of the scene's limit, 0 to 1; None if the scene has no limit."""
    lab_time_of_limit: float | None
    """Lab time as a share of the scene's limit, 0 to 1; None if the scene has no limit."""


class MedianCost(Record):
    """Median cost of the experiments over a group of episodes; None where no episode defines a value."""

    calls: float | None
    """Calls that the server received, including refused calls but not `answer`."""
    refused_calls: float | None
    """Calls that the server refused."""
    lab_time_s: float | None
    """Total simulated time of all steps [s]."""
    calls_of_limit: float | None
    """Calls as a share of the scene's limit, over the episodes whose scene has one."""
    n_calls_limited: int
    """Episodes whose scene limits calls."""
    lab_time_of_limit: float | None
    """Lab time as a share of the scene's limit, over the episodes whose scene has one."""
    n_lab_time_limited: int
    """Episodes whose scene limits lab time."""


def cost_of(episode: Episode, limits: LabLimits) -> ExperimentCost:
    """Compute the cost of an episode's experiments.

    Args:
        episode: The recorded episode.
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
    """Return the used share of a limit, at most 1, because calls beyond the limit are refused; None without a limit."""
    return None if limit is None else min(1.0, used / limit)


def median_cost(costs: Sequence[ExperimentCost]) -> MedianCost:
    """Return the median cost over a group of episodes."""
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
    """Return the simulated time after a call [s]: as returned, otherwise the time before plus the duration of a step.

    Args:
        exchange: The call with its result.
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
    """Whether a returned value is usable as a measurement: a finite number below 1e9 in magnitude."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) < 1e9


WEIGHTS = {"c": 0.40, "e": 0.15, "g": 0.15, "v": 0.10, "r": 0.10, "g_prime": 0.10}
"""Weights of the Final Score from the paper; they add up to 1."""

SCORING_VERSION = 2
"""Version of the scoring rules, stored with each summary; incremented when scores change but verdicts do not.

In version 1, a mean included only the episodes that define the dimension, G was a mean over episodes and counted
numbers in statements of intent as assertions, and V and R were defined for episodes without experiments.
"""

_WORD = re.compile(r"[^\W_]+(?:[._'’-][^\W_]+)*")


class EpisodeScores(Record):
    """The dimensions that a single episode defines: all except G′."""

    c: float | None
    """Graded correctness, 0 to 1; None if unscored."""
    e: float
    """1 - k / I_max for an answer in k of I_max iterations; 0 without an answer."""
    g: float | None
    """Share of the numbers stated in the reasoning that an earlier return supports; None if it states none."""
    g_plus: float | None
    """G+: as `g`, but numbers that follow by stated arithmetic from known numbers count as supported."""
    numbers: int
    """Number of assertions: numbers that the reasoning states, except those in statements of intent."""
    supported: int
    """Number of assertions that an earlier result supports."""
    derived: int
    """Number of unsupported assertions that follow by stated arithmetic."""
    v: float | None
    """V: share of calls without an error; None if the server ran no experiment."""
    v_enabled: float | None
    """As `v`, without calls of tools that the scene disables."""
    r: float | None
    """R: 1 - share of the most frequent repeated bigram; None without visible reasoning, or if the server ran no
    experiment."""
    step_credit: float | None
    """Share of the scene's intermediate quantities that are stated correctly; None if the scene names none."""
    silent_turns: int
    """Number of turns without visible reasoning."""
    unread_turns: int
    """Number of turns whose reply could not be parsed, for example because it had several lists of calls."""
    calls: int
    """Number of calls that V counts."""
    disabled_calls: int
    """Number of calls of tools that the scene disables."""


def final_score(c: float, e: float, g: float | None, v: float | None, r: float | None, g_prime: float | None) -> float:
    """FS, the Final Score from the dimensions of an episode or a group, 0 to 100; an undefined dimension counts 0.

    Source: the weights of the paper. They reproduce its published Final Scores to the last digit from its published
    dimensions.
    """
    return sum(100 * WEIGHTS[name] * (part or 0.0) for name, part in _parts(c, e, g, v, r, g_prime).items())


def final_score_of_defined(
    c: float, e: float, g: float | None, v: float | None, r: float | None, g_prime: float | None
) -> float:
    """FS*, the Final Score over the defined dimensions, 0 to 100; their weights are rescaled to add up to 1."""
    parts = {name: part for name, part in _parts(c, e, g, v, r, g_prime).items() if part is not None}
    return sum(100 * WEIGHTS[name] * part for name, part in parts.items()) / sum(WEIGHTS[name] for name in parts)


def _parts(*dimensions: float | None) -> dict[str, float | None]:
    return dict(zip(WEIGHTS, dimensions, strict=True))


def dimensions(episode: Episode, grade: Grade, grounding: Grounding, disabled_tools: frozenset[str]) -> EpisodeScores:
    """Compute the dimensions of one episode.

    Args:
        episode: The recorded episode.
        grade: Its grade.
        grounding: Its grounding.
        disabled_tools: Names of the tools that the scene disables.
    """
    made = [exchange for turn in episode.turns for exchange in turn.exchanges if _was_made(exchange)]
    enabled = [exchange for exchange in made if exchange.call.tool not in disabled_tools]
    has_experiment = any(exchange.returned and exchange.call.tool != ANSWER for exchange in made)
    return EpisodeScores(
        c=grade.graded,
        e=_efficiency(episode),
        g=grounding.share,
        g_plus=grounding.share_with_derived,
        numbers=len(grounding.assertions),
        supported=grounding.n_supported,
        derived=grounding.n_derived,
        v=_valid_share(made) if has_experiment else None,
        v_enabled=_valid_share(enabled) if has_experiment else None,
        r=non_repetition([turn.reasoning for turn in episode.turns]) if has_experiment else None,
        step_credit=sum(grade.steps.values()) / len(grade.steps) if grade.steps else None,
        silent_turns=sum(not turn.reasoning.strip() for turn in episode.turns),
        unread_turns=sum(turn.is_unread for turn in episode.turns),
        calls=len(made),
        disabled_calls=len(made) - len(enabled),
    )


def _valid_share(made: Sequence[Exchange]) -> float | None:
    return sum(not exchange.is_error for exchange in made) / len(made) if made else None


def _was_made(exchange: Exchange) -> bool:
    """Whether a call was made: it returned or was rejected. Calls after a rejected one are skipped, and so not made."""
    return exchange.returned or exchange.is_error


def _efficiency(episode: Episode) -> float:
    if episode.outcome is not Outcome.ANSWERED:
        return 0.0
    return max(0.0, 1 - len(episode.turns) / episode.allowance)


def non_repetition(reasoning: Iterable[str]) -> float | None:
    """R, the non-repetition of the reasoning: 1 - n / N.

    N is the number of bigrams, and n is how often the most frequent repeated bigram occurs. A bigram is two adjacent
    words of one turn, ignoring case and punctuation; a decimal number or an id such as `object_2` is one word. A bigram
    is repeated if it occurs at least twice in the episode. Without a repeated bigram, R is 1.

    Args:
        reasoning: The agent's reasoning, turn by turn.

    Returns:
        R from 0 to 1; None if the reasoning contains no word.
    """
    turns = [_WORD.findall(text.lower()) for text in reasoning]
    if not any(turns):
        return None
    bigrams = Counter(pair for words in turns for pair in itertools.pairwise(words))
    most = max(bigrams.values(), default=0)
    return 1 - most / bigrams.total() if most > 1 else 1.0
