"""A run in numbers: accuracies, the six dimensions and the Final Score, by whatever episodes are compared by. Pure.

Every number comes with how many episodes it speaks of. A dimension that an episode leaves undefined (no calls, no
assertions, no visible reasoning) is None there, counts 0 in means and in the Final Score, and its share is reported.
Unscored episodes (infrastructure errors) are counted as outcomes and left out of everything else.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean
from typing import NamedTuple, TypeVar

from evaluator.dimensions import WEIGHTS, EpisodeScores, dimensions, final_score, non_repetition
from evaluator.records import Episode, EpisodeKey, Grade, Outcome, Record, Verdict

__all__ = [
    "WEIGHTS",
    "EpisodeScores",
    "GroupSummary",
    "Interval",
    "RunSummary",
    "ScoredEpisode",
    "dimensions",
    "final_score",
    "held_out_accuracy",
    "non_repetition",
    "quadrant",
    "summarise",
    "wilson_interval",
]

_Z_95 = NormalDist().inv_cdf(0.975)
_Name = TypeVar("_Name", str, int)


@dataclass(frozen=True, slots=True)
class ScoredEpisode:
    """An episode, its grade, and what of its scene the reports group by."""

    episode: Episode
    grade: Grade
    category: str
    problem_type: str
    disabled_tools: frozenset[str] = frozenset()


class Interval(Record):
    """A confidence interval."""

    low: float
    high: float


class GroupSummary(Record):
    """The numbers of one group of episodes."""

    n: int
    """Episodes."""
    n_scored: int
    """Episodes with a verdict: the denominator of everything below but `outcomes`."""
    n_correct: int
    """Strictly correct ones."""
    strict_accuracy: float | None
    strict_interval: Interval | None
    """Wilson, 95 %; takes episodes as independent."""
    normalised_accuracy: float | None
    c: float | None
    e: float | None
    g: float | None
    """Mean with undefined ones as 0; None where no episode defines it. So are V and R."""
    v: float | None
    r: float | None
    g_prime: float | None
    """None where an agent of the group was tried on one category only."""
    final_score: float | None
    """0 to 100; None where G′ is None, for a score without one of its six parts compares with nothing."""
    g_undefined: float | None
    """Share of scored episodes without a quantitative assertion."""
    v_undefined: float | None
    """Share of scored episodes without a call."""
    r_undefined: float | None
    """Share of scored episodes without visible reasoning."""
    disabled_calls: int
    outcomes: dict[Outcome, int]


class RunSummary(Record):
    """A run in numbers: as a whole, and side by side in each way of grouping that the paper's hypotheses need."""

    overall: GroupSummary
    by_category: dict[str, GroupSummary]
    by_quadrant: dict[str, GroupSummary]
    """`easy-single`, `easy-multi`, `hard-single`, `hard-multi`, whatever the modality; other categories as they are."""
    by_problem_type: dict[str, GroupSummary]
    by_budget: dict[int, GroupSummary]
    by_prompting: dict[str, GroupSummary]
    by_agent: dict[str, GroupSummary]


def wilson_interval(successes: int, trials: int) -> Interval:
    """95 % interval of a proportion, by Wilson's score method.

    Five lines here rather than a statistics package that brings four others along; checked against published examples.

    Raises:
        ValueError: There are no trials.

    Source: Wilson 1927; examples in Newcombe 1998, Statistics in Medicine 17, 857-872, table I.
    """
    if trials < 1:
        raise ValueError("an interval needs at least one trial")
    share, square = successes / trials, _Z_95**2
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = _Z_95 / (1 + square / trials) * math.sqrt(share * (1 - share) / trials + square / (4 * trials**2))
    # At 0 and at all, the bound is 0 or 1 exactly; rounding must not leave it beside.
    low = 0.0 if successes == 0 else centre - half
    return Interval(low=low, high=1.0 if successes == trials else centre + half)


class _Condition(NamedTuple):
    """What must be equal for two episodes to speak of the same agent under test."""

    agent: str
    budget: int
    prompting: str
    protocol: str


def _condition(key: EpisodeKey) -> _Condition:
    return _Condition(key.agent, key.budget, key.prompting, key.protocol)


class _Row(NamedTuple):
    source: ScoredEpisode
    scores: EpisodeScores
    g_prime: float | None


def summarise(rows: Sequence[ScoredEpisode]) -> RunSummary:
    """The numbers of a run."""
    held_out = held_out_accuracy(rows)
    table = [
        _Row(
            row,
            dimensions(row.episode, row.grade, row.disabled_tools),
            held_out.get((_condition(row.episode.key), row.category)),
        )
        for row in rows
    ]
    return RunSummary(
        overall=_summary(table),
        by_category=_grouped(table, lambda row: row.category),
        by_quadrant=_grouped(table, lambda row: quadrant(row.category)),
        by_problem_type=_grouped(table, lambda row: row.problem_type),
        by_budget=_grouped(table, lambda row: row.episode.key.budget),
        by_prompting=_grouped(table, lambda row: row.episode.key.prompting),
        by_agent=_grouped(table, lambda row: row.episode.key.agent),
    )


def quadrant(category: str) -> str:
    """Difficulty and breadth of a category, such as `easy-multi` for `easy-multi-hidden`."""
    words = category.split("-")
    return "-".join(words[:2]) if words[0] in {"easy", "hard"} and words[1:2] in (["single"], ["multi"]) else category


def held_out_accuracy(rows: Iterable[ScoredEpisode]) -> Mapping[tuple[_Condition, str], float]:
    """G′ of each agent's categories: the mean of the strict accuracies of its *other* categories, each counted once.

    Nothing is pooled over agents, budgets, promptings or protocols. With one category there is no entry.
    """
    verdicts: defaultdict[_Condition, defaultdict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        if row.grade.strict is not Verdict.UNSCORED:
            right = row.grade.strict is Verdict.CORRECT
            verdicts[_condition(row.episode.key)][row.category].append(right)
    return {
        (condition, category): fmean(fmean(seen) for other, seen in categories.items() if other != category)
        for condition, categories in verdicts.items()
        for category in categories
        if len(categories) > 1
    }


def _grouped(table: Sequence[_Row], group: Callable[[ScoredEpisode], _Name]) -> dict[_Name, GroupSummary]:
    groups: defaultdict[_Name, list[_Row]] = defaultdict(list)
    for row in table:
        groups[group(row.source)].append(row)
    return {name: _summary(groups[name]) for name in sorted(groups)}


def _summary(table: Sequence[_Row]) -> GroupSummary:
    scored = [row for row in table if row.source.grade.strict is not Verdict.UNSCORED]
    n = len(scored)
    correct = sum(row.source.grade.strict is Verdict.CORRECT for row in scored)
    c = _mean([row.scores.c for row in scored])
    e = _mean([row.scores.e for row in scored])
    g, g_undefined = _counted([row.scores.g for row in scored])
    v, v_undefined = _counted([row.scores.v for row in scored])
    r, r_undefined = _counted([row.scores.r for row in scored])
    g_prime = None if any(row.g_prime is None for row in scored) else _mean([row.g_prime for row in scored])
    whole = None if c is None or e is None or g_prime is None else final_score(c, e, g, v, r, g_prime)
    return GroupSummary(
        n=len(table),
        n_scored=n,
        n_correct=correct,
        strict_accuracy=correct / n if n else None,
        strict_interval=wilson_interval(correct, n) if n else None,
        normalised_accuracy=sum(row.source.grade.normalised is Verdict.CORRECT for row in scored) / n if n else None,
        c=c,
        e=e,
        g=g,
        v=v,
        r=r,
        g_prime=g_prime,
        final_score=whole,
        g_undefined=g_undefined,
        v_undefined=v_undefined,
        r_undefined=r_undefined,
        disabled_calls=sum(row.scores.disabled_calls for row in scored),
        outcomes=dict(sorted(Counter(row.source.episode.outcome for row in table).items())),
    )


def _mean(values: Sequence[float | None]) -> float | None:
    """The mean of the defined values."""
    defined = [value for value in values if value is not None]
    return fmean(defined) if defined else None


def _counted(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    """The mean with undefined values as 0, None if all are; and the share of undefined ones."""
    if not values:
        return None, None
    undefined = sum(value is None for value in values) / len(values)
    return (None if undefined == 1 else fmean(value or 0.0 for value in values)), undefined
