"""Six dimensions and the Final Score of one episode, as the paper defines them. Pure, and knows no runs.

C graded correctness · E efficiency · G grounding · V valid calls · R non-repetition · G′ held-out category accuracy,
which takes the other categories of a run and so is computed in `evaluator.scores.metrics`.
"""

import itertools
import re
from collections import Counter
from collections.abc import Iterable

from evaluator.records import Episode, Exchange, Grade, Outcome, Record
from evaluator.scores.grounding import Grounding, grounding_of

WEIGHTS = {"c": 0.40, "e": 0.15, "g": 0.15, "v": 0.10, "r": 0.10, "g_prime": 0.10}
"""Weights of the Final Score, as the paper gives them; they add up to 1."""

_WORD = re.compile(r"[^\W_]+(?:[._'’-][^\W_]+)*")


class EpisodeScores(Record):
    """The dimensions that one episode defines by itself; G′ needs the other categories of the run."""

    c: float | None
    """Graded correctness, 0 to 1; None where unscored."""
    e: float
    """1 - k / I_max for an answer in k of I_max iterations; 0 without one."""
    g: float | None
    """Share of the reasoning's quantitative assertions that an earlier return supports; None without any."""
    v: float | None
    """Share of calls without error; None without calls."""
    r: float | None
    """1 - share of the most repeated pair of words; None without visible reasoning."""
    calls: int
    """Calls behind V."""
    disabled_calls: int
    """Calls to tools that the scene disables: in no share, reported apart."""


def final_score(c: float, e: float, g: float | None, v: float | None, r: float | None, g_prime: float | None) -> float:
    """The Final Score, 0 to 100; undefined dimensions count 0.

    Source: the paper's weights; its published rows of dimensions give its FS column to the digit printed.
    """
    parts = {"c": c, "e": e, "g": g, "v": v, "r": r, "g_prime": g_prime}
    return 100 * sum(weight * (parts[name] or 0.0) for name, weight in WEIGHTS.items())


def dimensions(
    episode: Episode,
    grade: Grade,
    disabled_tools: frozenset[str] = frozenset(),
    grounding: Grounding | None = None,
) -> EpisodeScores:
    """The dimensions of one episode.

    Args:
        episode: As recorded.
        grade: Its grade.
        disabled_tools: Names of the tools that the scene disables.
        grounding: That of the episode, where it is known already; most of the work goes into it.
    """
    made = [one for turn in episode.turns for one in turn.exchanges if _was_made(one)]
    calls = [one for one in made if one.call.tool not in disabled_tools]
    return EpisodeScores(
        c=grade.graded,
        e=_efficiency(episode),
        g=(grounding or grounding_of(episode)).share,
        v=sum(not one.is_error for one in calls) / len(calls) if calls else None,
        r=non_repetition([turn.reasoning for turn in episode.turns]),
        calls=len(calls),
        disabled_calls=len(made) - len(calls),
    )


def _was_made(exchange: Exchange) -> bool:
    """Tell whether a call counts: it returned, or was rejected; one that only stood behind a rejected call does not."""
    return exchange.returned or exchange.is_error


def _efficiency(episode: Episode) -> float:
    if episode.outcome is not Outcome.ANSWERED:
        return 0.0
    return max(0.0, 1 - len(episode.turns) / episode.allowance)


def non_repetition(reasoning: Iterable[str]) -> float | None:
    """R: 1 - the share that the most frequent repeated bigram has of all bigrams.

    A bigram is two neighbouring words of one turn, in any case, punctuation left out; a decimal number or an id such as
    `object_2` is one word. It is repeated if it occurs at least twice in the episode: with none repeated, R is 1.

    Args:
        reasoning: What the agent said, turn by turn.

    Returns:
        R from 0 to 1; None if there is not a word.
    """
    turns = [_WORD.findall(text.lower()) for text in reasoning]
    if not any(turns):
        return None
    bigrams = Counter(pair for words in turns for pair in itertools.pairwise(words))
    most = max(bigrams.values(), default=0)
    return 1 - most / bigrams.total() if most > 1 else 1.0
