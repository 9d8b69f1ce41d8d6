"""Summarises stated laws, which shows whether agents that predict correctly also know the law."""

from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from evaluator.records.episode import LawGrade, Record, Verdict


class StatedEpisode(NamedTuple):
    """An episode of a scene that asks for a law."""

    law: LawGrade | None
    """Grade of its law; None if it stated none."""
    verdict: Verdict
    """Strict verdict on the answer."""


class LawSummary(Record):
    """Counts of stated laws and of right answers, over episodes of scenes that ask for a law."""

    asked: int
    """Number of episodes."""
    stated: int
    """Number of episodes that stated a law."""
    known: int
    """Number of episodes whose law is equivalent to that of the laboratory."""
    predicted: int
    """Number of episodes with a right answer."""
    predicted_and_known: int
    """Number of episodes with a right answer and an equivalent law."""
    predicted_not_known: int
    """Number of episodes with a right answer and a law that is not equivalent."""
    predicted_not_stated: int
    """Number of episodes with a right answer and no law."""
    dependence_f1: float | None
    """Median F1 score of the quantities on which the stated laws depend; None if none was stated."""
    length: float | None
    """Median length of the equivalent laws; None if there is none."""


def law_summary(episodes: Iterable[StatedEpisode]) -> LawSummary | None:
    """Summarise the laws stated in some episodes; None without episodes."""
    found = list(episodes)
    if not found:
        return None
    right = [one for one in found if one.verdict is Verdict.CORRECT]
    laws = [one.law for one in found if one.law is not None]
    known = [law for law in laws if law.equivalent]
    return LawSummary(
        asked=len(found),
        stated=len(laws),
        known=len(known),
        predicted=len(right),
        predicted_and_known=sum(one.law is not None and one.law.equivalent for one in right),
        predicted_not_known=sum(one.law is not None and not one.law.equivalent for one in right),
        predicted_not_stated=sum(one.law is None for one in right),
        dependence_f1=median(law.dependence_f1 for law in laws) if laws else None,
        length=median(law.length for law in known) if known else None,
    )


def law_sentence(found: LawSummary) -> str:
    """State in a sentence how many episodes predicted correctly, and how many stated an equivalent law."""
    return (
        f"laws: stated in {found.stated} of {found.asked} episodes, equivalent in {found.known}; of {found.predicted}"
        f" that predicted, {found.predicted_and_known} knew the law, {found.predicted_not_known} stated another law and"
        f" {found.predicted_not_stated} stated none"
    )
