"""Evidence in reports: counts of verdicts for each agent, and a chart for each episode."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import NamedTuple

from evaluator.records.episode import SUFFICIENT, EpisodeKey, EvidenceRecord, EvidenceVerdict, Verdict, evidence_verdict
from evaluator.report.agent_results import AgentResults
from evaluator.report.charts import Chart, Point, Series, chart
from evaluator.report.tables import Cell, Table

_LEAST = 1e-3
"""Lower end of the charts; smaller bounds are drawn there [tolerances]."""


class EvidenceCounts(NamedTuple):
    """Counts of the verdicts on evidence over several episodes."""

    verdicts: Mapping[EvidenceVerdict, int]
    not_measurable: int
    until: float | None
    """Median number of calls until the evidence sufficed, over the episodes in which it did; None if there are none."""
    after: float | None
    """Median number of calls after the evidence sufficed, over the same episodes."""


def evidence_counts(records: Sequence[EvidenceRecord], verdicts: Mapping[EpisodeKey, Verdict]) -> EvidenceCounts:
    """Count the verdicts on evidence.

    Args:
        records: Evidence of some episodes.
        verdicts: Strict verdicts of episodes; one without a verdict is not counted.
    """
    found = Counter(evidence_verdict(one, verdicts.get(one.key, Verdict.UNSCORED)) for one in records)
    sufficed = [(one.sufficed_at, one.calls[-1].call) for one in records if one.sufficed_at is not None]
    return EvidenceCounts(
        {verdict: found[verdict] for verdict in EvidenceVerdict},
        sum(bool(one.not_measurable) for one in records),
        median(at for at, _ in sufficed) if sufficed else None,
        median(last - at for at, last in sufficed) if sufficed else None,
    )


def evidence_table(results: Sequence[AgentResults]) -> Table | None:
    """Table of the verdicts on evidence of each agent; None if no evidence was measured."""
    columns = ("agent", *map(str, EvidenceVerdict), "not measurable", "calls until it sufficed", "calls after")
    rows: list[list[Cell]] = []
    for result in results:
        verdicts = {row.key: row.grade.strict for row in result.rows}
        records = [found for key, found in result.run.evidence.items() if key in verdicts]
        if records:
            counts = evidence_counts(records, verdicts)
            rows.append([result.label, *counts.verdicts.values(), counts.not_measurable, counts.until, counts.after])
    return (
        Table("evidence", "Were the experiments at fault, or the reasoning?", columns, rows, decimals=1)
        if rows
        else None
    )


def evidence_charts(found: EvidenceRecord | None) -> list[Chart]:
    """Chart of the largest bound against the number of calls; empty if the scene asks for no number."""
    if found is None or not any(step.bounds for step in found.calls):
        return []
    points = [Point(step.call, math.log10(max(_LEAST, *step.bounds))) for step in found.calls if step.bounds]
    enough = [Point(end.x, math.log10(SUFFICIENT)) for end in (points[0], points[-1])]
    lines = [Series("bound", [points]), Series("sufficient", [enough])]
    return [chart("log₁₀ of the answer's smallest standard error [tolerances] against calls", lines)]
