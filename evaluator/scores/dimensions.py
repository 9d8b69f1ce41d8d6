"""Six dimensions and the Final Score of one episode, and the cost of its experiments. Pure.

A second efficiency beside E, which counts iterations: an iteration may hold any number of calls.

C graded correctness · E efficiency · G grounding · V valid calls · R non-repetition · G′ held-out category accuracy.
G′ depends on the other categories of a run, so `evaluator.scores.metrics` computes it.
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


WEIGHTS = {"c": 0.40, "e": 0.15, "g": 0.15, "v": 0.10, "r": 0.10, "g_prime": 0.10}
"""Weights of the Final Score, as the paper gives them; they add up to 1."""

SCORING_VERSION = 2
"""Stored with each summary; raised whenever a number can change although no verdict does.

In version 1 a mean was over the episodes that define a dimension, G was a mean over episodes and took the numbers of
plans for statements, and episodes without experiment defined V and R.
"""

_WORD = re.compile(r"[^\W_]+(?:[._'’-][^\W_]+)*")


class EpisodeScores(Record):
    """The dimensions that one episode defines by itself: all but G′."""

    c: float | None
    """Graded correctness, 0 to 1; None if unscored."""
    e: float
    """1 - k / I_max for an answer in k of I_max iterations; 0 without an answer."""
    g: float | None
    """Share of the numbers stated in the reasoning that an earlier return supports; None if it states none."""
    g_plus: float | None
    """The same, numbers included that follow by stated arithmetic from known ones."""
    numbers: int
    """Numbers that the reasoning states, those of plans left out."""
    supported: int
    """Those of them that an earlier return supports."""
    derived: int
    """Further ones that follow by stated arithmetic."""
    v: float | None
    """Share of calls without error; None if the laboratory ran no call."""
    v_enabled: float | None
    """The same without calls of tools that the scene disables."""
    r: float | None
    """1 - share of the most frequent repeated pair of words; None without visible reasoning, and if the laboratory
    ran no call."""
    step_credit: float | None
    """Share of the intermediate quantities of the scene that are stated rightly; None if it names none."""
    silent_turns: int
    """Turns without visible reasoning."""
    unread_turns: int
    """Turns whose reply could not be read, for example because it had several lists of calls."""
    calls: int
    """Calls that V counts."""
    disabled_calls: int
    """Those of them that call tools that the scene disables."""


def final_score(c: float, e: float, g: float | None, v: float | None, r: float | None, g_prime: float | None) -> float:
    """FS, the Final Score, 0 to 100, of the dimensions of an episode or a group; undefined ones count 0.

    Source: the paper's weights. With the paper's published dimensions they give its published Final Scores to the last
    digit.
    """
    return sum(100 * WEIGHTS[name] * (part or 0.0) for name, part in _parts(c, e, g, v, r, g_prime).items())


def final_score_of_defined(
    c: float, e: float, g: float | None, v: float | None, r: float | None, g_prime: float | None
) -> float:
    """FS*, the Final Score over the defined dimensions alone, with weights that add up to 1 again; 0 to 100."""
    parts = {name: part for name, part in _parts(c, e, g, v, r, g_prime).items() if part is not None}
    return sum(100 * WEIGHTS[name] * part for name, part in parts.items()) / sum(WEIGHTS[name] for name in parts)


def _parts(*dimensions: float | None) -> dict[str, float | None]:
    return dict(zip(WEIGHTS, dimensions, strict=True))


def dimensions(episode: Episode, grade: Grade, grounding: Grounding, disabled_tools: frozenset[str]) -> EpisodeScores:
    """The dimensions of one episode.

    Args:
        episode: As recorded.
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
    """Whether a call counts: it returned, or was rejected. A call that was skipped after a rejected one does not."""
    return exchange.returned or exchange.is_error


def _efficiency(episode: Episode) -> float:
    if episode.outcome is not Outcome.ANSWERED:
        return 0.0
    return max(0.0, 1 - len(episode.turns) / episode.allowance)


def non_repetition(reasoning: Iterable[str]) -> float | None:
    """R: 1 - n / N, with N bigrams in all, of which the most frequent repeated bigram occurs n times.

    A bigram is two neighbouring words of one turn, without regard to case or punctuation; a decimal number or an id
    such as `object_2` is one word. A bigram is repeated if it occurs at least twice in the episode. Without a repeated
    bigram, R is 1.

    Args:
        reasoning: The agent's reasoning, turn by turn.

    Returns:
        R from 0 to 1; None if the reasoning has no word.
    """
    turns = [_WORD.findall(text.lower()) for text in reasoning]
    if not any(turns):
        return None
    bigrams = Counter(pair for words in turns for pair in itertools.pairwise(words))
    most = max(bigrams.values(), default=0)
    return 1 - most / bigrams.total() if most > 1 else 1.0
