"""Summaries of several episodes besides accuracy: their verdicts on evidence, and the laws that agents stated."""

from collections import Counter
from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from evaluator.records.episode import Episode, LawGrade, Outcome, Record, Verdict
from evaluator.records.evidence import EvidenceRecord, EvidenceVerdict, evidence_verdict


class MeasuredEpisode(NamedTuple):
    """An episode whose evidence was measured, with its verdict."""

    episode: Episode
    evidence: EvidenceRecord
    verdict: Verdict
    """Strict verdict on the answer."""


class EvidenceSummary(Record):
    """Summary of the evidence of several episodes. Episodes whose evidence was not measured are not counted."""

    verdicts: dict[EvidenceVerdict, int]
    """Number of episodes with each verdict on evidence. Episodes without a verdict on the answer have none."""
    not_measurable: int
    """Number of episodes whose evidence cannot be measured."""
    answered_before: int
    """Number of episodes that were answered although their evidence did not suffice."""
    calls_until: float | None
    """Median number of calls until the evidence sufficed, over the episodes in which it did; None if in none."""
    calls_after: float | None
    """Median number of calls after the evidence sufficed, over the same episodes."""


def evidence_summary(measured: Iterable[MeasuredEpisode]) -> EvidenceSummary | None:
    """Summarise the evidence of some episodes; None if there are none."""
    found = list(measured)
    if not found:
        return None
    verdicts = Counter(evidence_verdict(one.evidence, one.verdict) for one in found)
    sufficed = [
        (at, sum(1 for _ in one.episode.accepted_calls()) - at)
        for one in found
        if (at := one.evidence.sufficed_at) is not None
    ]
    return EvidenceSummary(
        verdicts={verdict: verdicts[verdict] for verdict in EvidenceVerdict},
        not_measurable=sum(bool(one.evidence.not_measurable) for one in found),
        answered_before=sum(
            one.episode.outcome is Outcome.ANSWERED and not one.evidence.not_measurable and not one.evidence.suffices
            for one in found
        ),
        calls_until=median(at for at, _ in sufficed) if sufficed else None,
        calls_after=median(after for _, after in sufficed) if sufficed else None,
    )


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
    """Summarise the laws that agents wrote in some episodes; None without episodes."""
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
