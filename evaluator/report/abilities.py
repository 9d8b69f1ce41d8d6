"""The table of abilities from adaptive tests."""

from collections.abc import Sequence

from evaluator.report.agent_results import AgentResults
from evaluator.report.tables import Cell, Table


def abilities_table(results: Sequence[AgentResults]) -> Table | None:
    """The ability of each agent in an adaptive test; None if there was no such test."""
    found: list[list[Cell]] = []
    for result in results:
        for one in result.summary.abilities:
            place, ends = one.estimate, one.estimate.interval
            found.append([result.label, one.budget, place.answers, place.ability, place.se, ends.low, ends.high])
    columns = ("agent", "budget", "episodes", "ability, logits", "± SE", "95 % from", "to")
    note = (
        "Scenes were chosen by the answers before them. Abilities compare with those of other agents on the same"
        " calibration; the accuracies of an adaptive test compare with no others."
    )
    return Table("abilities", "Ability by adaptive test", columns, found, 2, note) if found else None
