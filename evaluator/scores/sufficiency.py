"""Counts the verdicts on evidence over several episodes, and the calls before and after their evidence sufficed."""

from collections import Counter
from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from evaluator.records.episode import Episode, Outcome, Record, Verdict
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
