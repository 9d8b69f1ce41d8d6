"""Tables on laws in reports: whether agents that predict correctly also state the law correctly."""

from collections.abc import Sequence

from evaluator.report.agent_results import AgentResults
from evaluator.report.tables import Cell, Count, Table
from evaluator.scores.laws import law_summary


def laws_table(results: Sequence[AgentResults]) -> Table | None:
    """Table of predictions and laws of each agent; None if no agent stated a law."""
    rows: list[list[Cell]] = []
    for result in results:
        found = law_summary(row.stated for row in result.rows if row.is_scored and row.stated)
        if found is None or not found.stated:
            continue
        counts = (found.predicted, found.stated, found.known)
        rows.append([
            result.label,
            *(Count(count, found.asked) for count in counts),
            *(Count(count, found.predicted) for count in (found.predicted_not_known, found.predicted_not_stated)),
            found.dependence_f1,
            None if found.length is None else round(found.length),
        ])  # fmt: skip
    columns = ("agent", "predicted", "stated a law", "knew the law", "predicted but did not know")
    columns += ("predicted, stated none", "F1 of dependences", "length of known laws")
    return Table("laws", "Do agents that predict also know?", columns, rows) if rows else None
