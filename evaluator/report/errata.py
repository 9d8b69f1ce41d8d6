"""The table of known faults of the packs that were played."""

from collections.abc import Sequence

from evaluator.report.agent_results import AgentResults
from evaluator.report.tables import Cell, Table
from evaluator.scores.wording import withdrawn_clause
from scenes import reference_of


def errata_table(results: Sequence[AgentResults]) -> Table | None:
    """Return the known faults of the packs that were played, with their effect on accuracies; None without any."""
    found: list[list[Cell]] = []
    for result in results:
        for one in result.summary.errata:
            entry = one.erratum
            scene = reference_of(entry.scene)
            found.append([result.label, scene, entry.pack, entry.effect.value, entry.fault, str(entry.date), one.n])
    if not found:
        return None
    clauses = [f"{result.label}: {withdrawn_clause(result.whole)}." for result in results if result.whole.n_withdrawn]
    columns = ("agent", "scene", "pack", "effect", "fault", "confirmed", "episodes")
    note = " ".join(["Withdrawn episodes have no verdict; noted ones keep theirs.", *clauses])
    return Table("errata", "Known faults of the packs that were played", columns, found, note=note)
