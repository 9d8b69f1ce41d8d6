"""The scores of a group of episodes: dimensions, Final Score, and the scores of blind guesses.

The Final Score of a group is computed from the dimensions of the group:

- C, E, V and R are means over all scored episodes; an episode that does not define one counts 0.
- G is pooled: supported numbers divided by all numbers that the group states; undefined below `FEWEST_NUMBERS`.
- G′ is a mean over the episodes of conditions with at least two categories.

FS counts an undefined dimension as 0; FS* omits it. FS is therefore 100 times the weighted sum of the dimensions that a
report shows.
"""

import math
from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from statistics import fmean
from typing import NamedTuple, TypeVar

from evaluator.answers.rewards import Chance
from evaluator.records.episode import EpisodeKey
from evaluator.scores.dimensions import EpisodeScores, final_score, final_score_of_defined
from evaluator.statistics.intervals import Interval
from scenes import Category

NO_RUNG = "–"
"""Rung of scenes without a known category, such as published packs."""
_RUNGS = {category.value: category.rung.value for category in Category}

QUALITATIVE, QUANTITATIVE = "qualitative", "quantitative"
_KINDS = {
    "comparison": QUALITATIVE,
    "observation": QUALITATIVE,
    "calculation": QUANTITATIVE,
    "computation": QUANTITATIVE,
}


class Condition(NamedTuple):
    """Agent and settings that two episodes must share to count as results of the same condition."""

    agent: str
    budget: int
    prompting: str
    protocol: str


def condition(key: EpisodeKey) -> Condition:
    """The condition under which an episode was played."""
    return Condition(key.agent, key.budget, key.prompting, key.protocol)


def rung(category: str) -> str:
    """Return `easy`, `hard` or `open`; `NO_RUNG` for an unknown category."""
    return _RUNGS.get(category, NO_RUNG)


def quadrant(category: str) -> str:
    """Return difficulty and breadth of a category, such as `easy-multi` for `easy-multi-hidden`."""
    return _parts(category)[0]


def modality(category: str) -> str:
    """Return the modality of a category: `creation`, `hidden` or `plain`; other categories unchanged."""
    return _parts(category)[1]


def _parts(category: str) -> tuple[str, str]:
    difficulty, breadth, *rest = [*category.split("-"), ""]
    if difficulty not in {"easy", "hard"} or breadth not in {"single", "multi"}:
        return category, category
    return f"{difficulty}-{breadth}", "-".join(filter(None, rest)) or "plain"


def problem_kind(problem_type: str) -> str:
    """Return `qualitative` (comparison, observation), `quantitative` (calculation, computation) or `other`."""
    return _KINDS.get(problem_type.strip().lower(), "other")


FEWEST_NUMBERS = 20
"""Smallest number of stated numbers for which a group has a G."""

_Condition = TypeVar("_Condition", bound=Hashable)


class ScorePoint(NamedTuple):
    """The data of a scored episode from which group scores are computed."""

    scores: EpisodeScores
    chance: Chance
    """Expected scores of a blind guess in this episode."""
    allowance: int
    """Largest number of turns in the episode."""
    g_prime: float | None
    blind_g_prime: float | None
    """G′ if every episode of the condition were answered by a blind guess."""


class GroupScores(NamedTuple):
    """The scores of a group. For the meaning of the fields see `GroupSummary`."""

    c: float | None
    e: float | None
    g: float | None
    g_plus: float | None
    v: float | None
    v_enabled: float | None
    r: float | None
    g_prime: float | None
    step_credit: float | None
    n_defined: dict[str, int]
    n_numbers: int
    final_score: float | None
    final_score_of_defined: float | None
    gated: float | None
    blind_accuracy: float | None
    blind_score: float | None


def group_scores(points: Sequence[ScorePoint]) -> GroupScores:
    """Compute the scores of a group of scored episodes."""
    own = [point.scores for point in points]
    of_all = {name: [getattr(scores, name) for scores in own] for name in ("c", "e", "v", "v_enabled", "r")}
    of_some = {"step_credit": [scores.step_credit for scores in own], "g_prime": [point.g_prime for point in points]}
    counted = {**of_all, **of_some, "g": [s.g for s in own], "g_plus": [s.g_plus for s in own]}
    n_defined = {name: sum(value is not None for value in values) for name, values in counted.items()}
    means = {name: _mean(values, len(points)) for name, values in of_all.items()}
    means |= {name: _mean(values, n_defined[name]) for name, values in of_some.items()}
    numbers, supported = sum(s.numbers for s in own), sum(s.supported for s in own)
    if numbers >= FEWEST_NUMBERS:
        means |= {"g": supported / numbers, "g_plus": (supported + sum(s.derived for s in own)) / numbers}
    c, e, g, v, r, g_prime = (means.get(name) for name in ("c", "e", "g", "v", "r", "g_prime"))
    parts = (c or 0.0, e or 0.0, g, v, r, g_prime)
    has_score = bool(points) and n_defined["g_prime"] == len(points)
    return GroupScores(
        c=c,
        e=e,
        g=g,
        g_plus=means.get("g_plus"),
        v=v,
        v_enabled=means["v_enabled"],
        r=r,
        g_prime=g_prime,
        step_credit=means["step_credit"],
        n_defined=n_defined,
        n_numbers=numbers,
        final_score=final_score(*parts) if has_score else None,
        final_score_of_defined=final_score_of_defined(*parts) if points else None,
        gated=fmean(map(_gated, own)) if points else None,
        blind_accuracy=fmean(point.chance.strict for point in points) if points else None,
        blind_score=_blind_score(points),
    )


def _mean(values: Sequence[float | None], count: int) -> float | None:
    """Divide the sum of the defined values by a count; None if no value is defined."""
    known = [value for value in values if value is not None]
    return math.fsum(known) / count if known else None


def _gated(own: EpisodeScores) -> float:
    """Return C · FS* of an episode without G′: a product, so the process counts in proportion to correctness."""
    c = own.c or 0.0
    return c * final_score_of_defined(c, own.e, own.g, own.v, own.r, None)


def _blind_score(points: Sequence[ScorePoint]) -> float | None:
    """Return the expected FS of an agent that answers each of these episodes at once by a blind guess."""
    held_out = [point.blind_g_prime for point in points if point.blind_g_prime is not None]
    if not points or len(held_out) < len(points):
        return None
    c = fmean(point.chance.graded for point in points)
    e = fmean(1 - 1 / point.allowance for point in points)
    return final_score(c, e, None, None, None, fmean(held_out))


def skill(accuracy: float, blind: float) -> float | None:
    """Rescale an accuracy so that a blind guess has 0 and a perfect agent 1; None if every guess is right."""
    return (accuracy - blind) / (1 - blind) if blind < 1 else None


def skill_interval(accuracy: Interval, blind: float) -> Interval | None:
    """Rescale the confidence interval of an accuracy to the skill score.

    The accuracy of a blind guess is computed and not estimated, so it adds no uncertainty.
    """
    low, high = skill(accuracy.low, blind), skill(accuracy.high, blind)
    return None if low is None or high is None else Interval(low=low, high=high)


def held_out(values: Iterable[tuple[_Condition, str, float]]) -> Mapping[tuple[_Condition, str], float]:
    """Return the mean over the *other* categories, for each condition and category.

    Each category has the same weight. A condition with a single category has no entry.

    Args:
        values: Condition, category and value of each episode.
    """
    found: defaultdict[_Condition, defaultdict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for condition, category, value in values:
        found[condition][category].append(value)
    return {
        (condition, category): fmean(fmean(seen) for other, seen in categories.items() if other != category)
        for condition, categories in found.items()
        for category in categories
        if len(categories) > 1
    }
