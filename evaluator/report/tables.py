"""The tables of a report in the paper's layout, as format-independent cells for the page and for `--export`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from evaluator.records.episode import NormalisationClass
from evaluator.report.agent_results import BUDGETS, PAPER, AgentResults
from evaluator.scores.failures.findings import FailureMode
from evaluator.scores.grouping import NO_RUNG, quadrant
from evaluator.scores.metrics import GroupSummary
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.wording import counted, floor_sentence
from evaluator.statistics.intervals import Proportion, proportion
from scenes import Rung


class Share(NamedTuple):
    """A share with its 95 % interval and its number of episodes."""

    value: float
    low: float | None
    high: float | None
    n: int | None
    """Number of episodes; None for a share quoted from the paper."""


class Score(NamedTuple):
    """A Final Score, 0 to 100."""

    value: float


class Noted(NamedTuple):
    """A number with three decimals, and a note."""

    value: float | None
    note: str
    """For example the number of episodes or the interval; may be empty."""


class Count(NamedTuple):
    """A number of episodes out of a total."""

    n: int
    of: int


DIMENSIONS = {
    "C": "c",
    "E": "e",
    "G": "g",
    "G+": "g_plus",
    "V": "v",
    "V of enabled tools": "v_enabled",
    "R": "r",
    "G′": "g_prime",
}
"""Titles of the dimensions → fields of a summary."""

Cell = str | int | float | Share | Score | Noted | Count | None


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names its rows."""

    name: str
    """Identifier of the table, used in file names and labels."""
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    decimals: int = 3
    """Number of decimals of plain numbers."""
    note: str = ""
    """A sentence shown below the table."""


def tables(results: Sequence[AgentResults]) -> list[Table]:
    """All tables of a report: the suite's in the paper's order, results quoted from the paper, and results by rung."""
    suite = [result for result in results if result.suite]
    of_suite = (by_budget, by_category, main_metrics, six_dimensions, forgiven, failure_modes)
    return [*(table(suite) for table in of_suite if suite), quoted(), by_rung(results), experiment_cost(results)]


def by_budget(
    results: Sequence[AgentResults], name: str = "", wanted: Callable[[ScoredEpisode], bool] | None = None
) -> Table:
    """Strict accuracy at each budget.

    Args:
        results: The results to show.
        name: Description of the selected episodes, for the title; empty for all.
        wanted: Predicate that selects episodes; None selects all.
    """
    budgets = sorted({row.key.budget for result in results for row in result.suite})
    found: list[list[Cell]] = []
    for result in results:
        cells = accuracies(result.suite, lambda row: row.key.budget, wanted)
        if cells or wanted is None:
            found.append([result.label, *(share_of(cells.get(budget)) for budget in budgets)])
    title = "Strict accuracy by iteration budget" + (f", {name}" if name else "")
    return Table("overall_by_budget", title, ("agent", *map(str, budgets)), found)


def by_category(results: Sequence[AgentResults]) -> Table:
    """Strict accuracy in each category, over all budgets."""
    return side_by_side(results, "category", "Strict accuracy by category", lambda result: result.summary.by_category)


def side_by_side(
    results: Sequence[AgentResults],
    name: str,
    title: str,
    groups: Callable[[AgentResults], Mapping[Any, GroupSummary]],
) -> Table:
    """Strict accuracy in each group of a grouping, one column for each agent.

    Args:
        results: The results to show.
        name: Name of the grouping.
        title: Title of the table.
        groups: Function that returns the summaries of an agent's groups.
    """
    names = sorted({group for result in results for group in groups(result)})
    found = [[str(group), *(_strict(groups(result).get(group)) for result in results)] for group in names]
    return Table(f"by_{name.replace(' ', '_')}", title, (name, *(result.label for result in results)), found)


def by_rung(results: Sequence[AgentResults]) -> Table:
    """Strict accuracy on each rung, one row for each agent. Open worlds also show the share of correct predictions."""
    groups = [result.summary.by_rung for result in results]
    columns: dict[str, list[Cell]] = {}
    for rung in (*Rung, NO_RUNG):
        found = [group.get(rung) for group in groups]
        if rung == Rung.OPEN and any(found):
            columns["open: all predictions right"] = list(map(_strict, found))
            columns["open: predictions right"] = list(map(_graded, found))
        elif any(found):
            columns[str(rung)] = list(map(_strict, found))
    rows = [[result.label, *(column[index] for column in columns.values())] for index, result in enumerate(results)]
    return Table("by_rung", "Accuracy by rung", ("agent", *columns), rows)


def experiment_cost(results: Sequence[AgentResults]) -> Table:
    """Calls and lab time per episode, for each agent in the suite and on each rung."""
    found: list[list[Cell]] = []
    for result in results:
        rungs = result.summary.by_rung
        whole = {"all": result.whole} if len(set(rungs) - {Rung.OPEN}) > 1 else {}
        found += [[result.label, name, *_costs(group)] for name, group in (whole | rungs).items()]
    columns = ("agent", "rung", "episodes", "calls", "refused", "lab time [s]", "of call limit", "of lab time limit")
    title = "Cost of experiment: medians over scored episodes"
    return Table("experiment_cost", title, columns, found, decimals=2)


def _costs(group: GroupSummary) -> list[Cell]:
    cost = group.experiment_cost
    return [
        group.n_scored,
        *map(_whole, (cost.calls, cost.refused_calls)),
        cost.lab_time_s,
        None if cost.calls_of_limit is None else Share(cost.calls_of_limit, None, None, cost.n_calls_limited),
        None if cost.lab_time_of_limit is None else Share(cost.lab_time_of_limit, None, None, cost.n_lab_time_limited),
    ]


def _whole(count: float | None) -> float | None:
    """Convert a median of counts to `int`, unless it lies halfway between two counts."""
    return int(count) if count is not None and count.is_integer() else count


_EFFORT = ("iterations", "calls", "US$ per episode")


def main_metrics(results: Sequence[AgentResults]) -> Table:
    """Table of accuracies, Skill, Gated, Final Score, and mean effort and cost."""
    columns = ("agent", "episodes", "strict", "normalised", "Skill", "Gated", "Final Score", *_EFFORT)
    found: list[list[Cell]] = []
    for result in results:
        cost = result.spending.cost_usd
        found.append(
            [
                result.label,
                result.whole.n_scored,
                _strict(result.whole),
                _normalised(result.whole),
                _skill(result.whole),
                _score(result.whole.gated),
                _score(result.whole.final_score),
                result.spending.iterations,
                result.spending.calls,
                None if cost is None else cost / result.spending.n_priced,
            ]
        )
    return Table("main_metrics", "Main metrics", columns, found, decimals=2, note=floors(results))


def floors(results: Sequence[AgentResults]) -> str:
    """State the Skill, Gated and accuracy that an agent without experiments would reach, in one sentence."""
    found = floor_sentence({result.label: result.whole for result in results})
    return f"{found[0].upper()}{found[1:]}." if found else ""


def six_dimensions(results: Sequence[AgentResults]) -> Table:
    """Table of the six dimensions, G+, V restricted to enabled tools, and the Final Scores FS and FS*."""
    found: list[list[Cell]] = [
        [
            result.label,
            *(mean_of(result.whole, name) for name in DIMENSIONS.values()),
            _score(result.whole.final_score),
            _score(result.whole.final_score_of_defined),
        ]
        for result in results
    ]
    columns = ("agent", *DIMENSIONS, "Final Score", "FS*")
    return Table("six_dimensions", "Six dimensions", columns, found, note=floors(results))


def forgiven(results: Sequence[AgentResults]) -> Table:
    """Number of scored episodes that only normalised grading accepts, by class of normalisation."""
    found = [
        [
            reason.value.replace("_", " "),
            *(Count(result.whole.forgiven[reason], result.whole.n_scored) for result in results),
        ]
        for reason in NormalisationClass
    ]
    return Table("forgiven", "Answers that only normalised grading accepts", ("reason", *_labels(results)), found)


def _labels(results: Sequence[AgentResults]) -> list[str]:
    return [result.label for result in results]


def failure_modes(results: Sequence[AgentResults]) -> Table:
    """Number of scored episodes with each failure mode."""
    found = [
        [
            mode.value.replace("_", " "),
            *(Count(result.whole.failures[mode].n, result.whole.n_scored) for result in results),
        ]
        for mode in FailureMode
    ]
    return Table("failure_modes", "Failure modes", ("failure mode", *(result.label for result in results)), found)


def quoted() -> Table:
    """Table of the results quoted from the paper, for comparison."""
    return Table(
        "paper_by_budget",
        "Accuracy by iteration budget as the paper prints it (measured on other scenes)",
        ("model", *map(str, BUDGETS)),
        [[quote.model, *(Share(value / 100, None, None, None) for value in quote.accuracy)] for quote in PAPER],
    )


_GROUPS = ("easy-single", "easy-multi", "hard-single", "hard-multi")


def group_picks(results: Sequence[AgentResults]) -> list[tuple[str, Callable[[ScoredEpisode], bool] | None]]:
    """Names and predicates of the groups to report: all episodes, and each group of categories that was played."""
    played = {quadrant(row.category) for result in results for row in result.suite}

    def picks(group: str) -> Callable[[ScoredEpisode], bool]:
        return lambda row: quadrant(row.category) == group

    return [("all", None), *((group, picks(group)) for group in _GROUPS if group in played)]


def accuracies(
    rows: Sequence[ScoredEpisode],
    group: Callable[[ScoredEpisode], Any],
    wanted: Callable[[ScoredEpisode], bool] | None = None,
) -> dict[Any, Proportion]:
    """Strict accuracy of each group of scored episodes.

    Args:
        rows: Scored episodes.
        group: Function that returns the group of an episode.
        wanted: Predicate that selects episodes; None selects all.
    """
    verdicts: dict[Any, list[tuple[int, bool]]] = {}
    for row in rows:
        if row.is_scored and (wanted is None or wanted(row)):
            verdicts.setdefault(group(row), []).append((row.key.scene, row.is_correct))
    return {name: proportion(verdicts[name]) for name in sorted(verdicts)}


def share_of(found: Proportion | None) -> Share | None:
    """Convert a proportion to a table cell."""
    return None if found is None else Share(found.share, found.interval.low, found.interval.high, found.n)


def mean_of(group: GroupSummary, name: str) -> Noted:
    """Convert a dimension of a group to a table cell.

    Args:
        group: Summary of the group.
        name: Name of the dimension's field in the summary.
    """
    return Noted(getattr(group, name), counted(group, name))


def _skill(group: GroupSummary) -> Noted:
    ends = group.skill_interval
    return Noted(group.skill, "" if ends is None else f"{ends.low:.2f} to {ends.high:.2f}")


def _score(value: float | None) -> Score | None:
    return None if value is None else Score(value)


def _strict(group: GroupSummary | None) -> Share | None:
    if group is None or group.strict_accuracy is None or group.strict_interval is None:
        return None
    return Share(group.strict_accuracy, group.strict_interval.low, group.strict_interval.high, group.n_scored)


def _graded(group: GroupSummary | None) -> Share | None:
    return None if group is None or group.c is None else Share(group.c, None, None, group.n_scored)


def _normalised(group: GroupSummary) -> Share | None:
    if group.normalised_accuracy is None or group.normalised_interval is None:
        return None
    return Share(
        group.normalised_accuracy, group.normalised_interval.low, group.normalised_interval.high, group.n_scored
    )
