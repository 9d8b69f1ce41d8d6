"""The groups in which episodes are reported: by condition, rung, and parts of a category or a problem type. Pure."""

from typing import NamedTuple

from evaluator.records.episode import EpisodeKey
from scenes import Category

NO_RUNG = "–"
"""The group of scenes without a known category, such as published packs."""
_RUNGS = {category.value: category.rung.value for category in Category}

QUALITATIVE, QUANTITATIVE = "qualitative", "quantitative"
_KINDS = {
    "comparison": QUALITATIVE,
    "observation": QUALITATIVE,
    "calculation": QUANTITATIVE,
    "computation": QUANTITATIVE,
}


class Condition(NamedTuple):
    """What two episodes must share to be results of the same agent under the same setting."""

    agent: str
    budget: int
    prompting: str
    protocol: str


def condition(key: EpisodeKey) -> Condition:
    """The condition under which an episode was played."""
    return Condition(key.agent, key.budget, key.prompting, key.protocol)


def rung(category: str) -> str:
    """`easy`, `hard` or `open`; `NO_RUNG` for a category that is not known."""
    return _RUNGS.get(category, NO_RUNG)


def quadrant(category: str) -> str:
    """Difficulty and breadth of a category, such as `easy-multi` for `easy-multi-hidden`."""
    return _parts(category)[0]


def modality(category: str) -> str:
    """What a category adds to its quadrant: `creation`, `hidden`, else `plain`; other categories as they are."""
    return _parts(category)[1]


def _parts(category: str) -> tuple[str, str]:
    difficulty, breadth, *rest = [*category.split("-"), ""]
    if difficulty not in {"easy", "hard"} or breadth not in {"single", "multi"}:
        return category, category
    return f"{difficulty}-{breadth}", "-".join(filter(None, rest)) or "plain"


def problem_kind(problem_type: str) -> str:
    """`qualitative` (comparison, observation), `quantitative` (calculation, computation), or `other`."""
    return _KINDS.get(problem_type.strip().lower(), "other")
