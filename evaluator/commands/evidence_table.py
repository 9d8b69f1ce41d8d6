"""Tables of evidence verdicts, printed by several commands."""

from collections.abc import Mapping

from rich.table import Table
from rich.text import Text

from evaluator.commands.terminal import printable
from evaluator.records.evidence import EvidenceVerdict
from evaluator.scores.scored_episode import EvidenceSummary

_CALLS = ("answered before the evidence", "calls until it sufficed (median)", "calls after it (median)")


def evidence_table(rows: Mapping[str, EvidenceSummary]) -> Table:
    """A table with a row for each agent, or for each side of a comparison.

    Args:
        rows: Name of the row → evidence of its episodes.
    """
    table = Table("", *EvidenceVerdict, "not measurable", *_CALLS)
    for name, found in rows.items():
        calls = ("–" if calls is None else f"{calls:g}" for calls in (found.calls_until, found.calls_after))
        counts = (*found.verdicts.values(), found.not_measurable, found.answered_before)
        table.add_row(Text(printable(name)), *map(str, counts), *calls)
    return table
