"""The tables of the paper in its layout: the run's agents, and the paper's models on the paper's scenes."""

from collections.abc import Sequence
from typing import NamedTuple

from evaluator.records.episode import NormalisationClass
from evaluator.report.agent_results import BUDGETS, CATEGORIES, PAPER, REGRADED, AgentResults
from evaluator.report.tables import Cell, Score, Share, Table, floors, mean_of
from evaluator.scores.dimensions import WEIGHTS

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
