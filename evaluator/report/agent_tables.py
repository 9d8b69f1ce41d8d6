"""Tables with rows for each agent: abilities, known faults, laws, the grid of verdicts, and the tables of the paper."""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from evaluator.records.episode import NormalisationClass, Verdict
from evaluator.report.agent_results import BUDGETS, CATEGORIES, PAPER, REGRADED, AgentResults
from evaluator.report.notebook import Entry
from evaluator.report.tables import Cell, Count, Score, Share, Table, floors, mean_of
from evaluator.scores.dimensions import WEIGHTS
from evaluator.scores.scored_episode import law_summary
from evaluator.scores.wording import withdrawn_clause
from scenes import reference_of


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


_SYMBOLS = {"correct": "✓", "incorrect": "✗", "mixed": "±", "unscored": "–", "": ""}


class VerdictCell(NamedTuple):
    """A cell of the grid: the verdicts on the episodes of one agent in one scene."""

    state: str
    """`correct`, `incorrect`, `unscored`, or `mixed` if its scored episodes differ; empty if there is none."""
    symbol: str
    """One character for the state, so that colour is not the only distinction."""
    words: str
    """Text of the cell: scene and state, such as `28 Glider between cords: 2 of 3 correct`."""
    href: str
    """Link to the notebook of its only episode, or to the list of episodes."""
    chosen: str
    """Filter by which the list shows only the episodes of this cell; empty if the cell links to a notebook."""


def verdict_grid(entries: Sequence[Entry], agents: int) -> list[list[VerdictCell]]:
    """For each agent, a cell for each scene; the scenes are in the same order for all.

    Args:
        entries: The episodes of the report, in order of scene.
        agents: Number of agents in the report.
    """
    found: defaultdict[tuple[int, int], list[Entry]] = defaultdict(list)
    titles: dict[int, str] = {}
    for entry in entries:
        found[entry.agent_index, entry.row.key.scene].append(entry)
        titles[entry.row.key.scene] = entry.row.scene_title
    return [
        [_cell(agent, scene, title, found[agent, scene]) for scene, title in titles.items()] for agent in range(agents)
    ]


def _cell(agent: int, scene: int, title: str, played: Sequence[Entry]) -> VerdictCell:
    scored = [entry.row.is_correct for entry in played if entry.row.grade.strict is not Verdict.UNSCORED]
    if not played:
        state, words = "", "not played"
    elif not scored:
        state, words = "unscored", "unscored"
    else:
        state = "mixed" if 0 < sum(scored) < len(scored) else "correct" if scored[0] else "incorrect"
        words = state if len(played) == 1 else f"{sum(scored)} of {len(scored)} correct"
    if len(played) > 1:
        return VerdictCell(state, _SYMBOLS[state], f"{title}: {words}", "#episodes", f"scene={scene}&agent={agent}")
    return VerdictCell(state, _SYMBOLS[state], f"{title}: {words}", "".join(f"#{one.id}" for one in played), "")


MARK = " †"
"""Suffix of the names of models whose results are quoted from the paper."""


class Bucket(NamedTuple):
    """A colour of the paper's heat map."""

    below: float
    """Upper end of the bucket's accuracies, exclusive, as a share from 0 to 1."""
    name: str
    title: str


BUCKETS = (
    Bucket(0.2, "low", "<20"),
    Bucket(0.4, "mid-low", "20–39"),
    Bucket(0.6, "mid", "40–59"),
    Bucket(0.8, "high", "60–79"),
    Bucket(float("inf"), "top", "≥80"),
)


def bucket(share: float) -> Bucket:
    """Return the colour of an accuracy from 0 to 1 in the paper's heat map."""
    # The paper rounds to one decimal before it chooses the colour: 0.1999… is 20.0.
    return next(found for found in BUCKETS if round(share, 3) < found.below)


def paper_tables(results: Sequence[AgentResults]) -> list[Table]:
    """The tables of the paper, in the paper's order. They exclude open worlds."""
    return [_budgets(results), _metrics(results), heat_map(results), _dimensions(results), _regraded(results)]


def _budgets(results: Sequence[AgentResults]) -> Table:
    budgets = sorted({*BUDGETS, *(row.key.budget for result in results for row in result.suite)})
    rows: list[list[Cell]] = []
    for budget in budgets:
        groups = [result.summary.by_budget.get(budget) for result in results]
        ours: list[Cell] = [group and _plain(group.strict_accuracy) for group in groups]
        place = BUDGETS.index(budget) if budget in BUDGETS else None
        theirs: list[Cell] = [None if place is None else _plain(model.accuracy[place] / 100) for model in PAPER]
        rows.append([str(budget), *ours, *theirs])
    return Table("paper_overall", "Overall accuracy (%) by iteration budget", ("I_max", *_models(results)), rows)


def _metrics(results: Sequence[AgentResults]) -> Table:
    rows: list[list[Cell]] = []
    for result in results:
        whole = result.whole
        means = (mean_of(whole, "g"), mean_of(whole, "v"))
        rows.append([result.label, _plain(whole.strict_accuracy), _score(whole.final_score), *means])
    for model in PAPER:
        _, _, g, v, _, _ = model.dimensions
        rows.append([model.model + MARK, _plain(model.mean_accuracy / 100), Score(model.final_score), g, v])
    columns = ("Model", "Acc. (%)", "Avg. FS", "Ground.", "Act. Val.")
    title = "Metrics of each model over all iteration budgets"
    return Table("paper_metrics", title, columns, rows, note=floors(results))


def heat_map(results: Sequence[AgentResults]) -> Table:
    """Table of accuracy by category, in the paper's order of categories."""
    rows: list[list[Cell]] = []
    for place, (category, title) in enumerate(CATEGORIES.items()):
        groups = [result.summary.by_category.get(category) for result in results]
        ours: list[Cell] = [group and _plain(group.strict_accuracy) for group in groups]
        rows.append([title, *ours, *(_plain(model.by_category[place] / 100) for model in PAPER)])
    return Table("paper_heat_map", "Accuracy (%) by category", ("Category", *_models(results)), rows)


def _dimensions(results: Sequence[AgentResults]) -> Table:
    rows: list[list[Cell]] = []
    for result in results:
        whole = result.whole
        means = [mean_of(whole, name) for name in WEIGHTS]
        rows.append([result.label, _plain(whole.strict_accuracy), *means, _score(whole.final_score)])
    for model in PAPER:
        cells = (_plain(model.mean_accuracy / 100), *model.dimensions, Score(model.final_score))
        rows.append([model.model + MARK, *cells])
    columns = ("Model", "Acc. (%)", "C", "E", "G", "V", "R", "G′", "FS")
    return Table("paper_dimensions", "Six scoring dimensions", columns, rows, note=floors(results))


def _regraded(results: Sequence[AgentResults]) -> Table:
    rows: list[list[Cell]] = []
    for reason in NormalisationClass:
        forgiven = [row for result in results for row in result.suite if row.grade.normalisation is reason]
        scenes = len({row.key.scene for row in forgiven})
        rows.append([reason.value.replace("_", " "), len(forgiven), scenes, *REGRADED[reason.value]])
    columns = ("Class", "cases", "scenes", "cases" + MARK, "scenes" + MARK)
    return Table("paper_regraded", "Re-graded answers by class of normalisation", columns, rows)


def _models(results: Sequence[AgentResults]) -> list[str]:
    return [*(result.label for result in results), *(model.model + MARK for model in PAPER)]


def _plain(share: float | None) -> Share | None:
    return None if share is None else Share(share, None, None, None)


def _score(value: float | None) -> Score | None:
    return None if value is None else Score(value)
