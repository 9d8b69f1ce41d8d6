"""The tables of a report in the paper's layout, as plain cells: what the page shows and what `--export` writes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from evaluator.failures.findings import FailureMode
from evaluator.records import Verdict
from evaluator.report.contenders import Contender
from evaluator.report.quoted import BUDGETS, PAPER
from evaluator.scores.grouping import quadrant
from evaluator.scores.metrics import GroupSummary, ScoredEpisode
from evaluator.statistics.intervals import Proportion, proportion


class Share(NamedTuple):
    """A share with its 95 % interval and the episodes behind it."""

    value: float
    low: float | None
    high: float | None
    n: int | None


class Score(NamedTuple):
    """A Final Score, 0 to 100."""

    value: float


class Count(NamedTuple):
    """How many of how many."""

    n: int
    of: int


Cell = str | int | float | Share | Score | Count | None


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names its rows."""

    name: str
    """For file names."""
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    decimals: int = 3
    """Of the bare numbers in it."""


def tables(who: Sequence[Contender]) -> list[Table]:
    """All tables, in the paper's order."""
    return [by_budget(who), by_category(who), main_metrics(who), six_dimensions(who), failure_modes(who), quoted()]


def by_budget(who: Sequence[Contender], name: str = "", rows: Callable[[ScoredEpisode], bool] | None = None) -> Table:
    """Strict accuracy at each budget, of all episodes or of those that `rows` picks."""
    budgets = sorted({row.episode.key.budget for one in who for row in one.rows})
    found: list[list[Cell]] = []
    for one in who:
        cells = accuracies(one.rows, lambda row: row.episode.key.budget, rows)
        if cells or rows is None:
            found.append([one.label, *(share_of(cells.get(budget)) for budget in budgets)])
    title = "Strict accuracy by iteration budget" + (f", {name}" if name else "")
    return Table("overall_by_budget", title, ("agent", *map(str, budgets)), found)


def by_category(who: Sequence[Contender]) -> Table:
    """Strict accuracy of each category, over all budgets."""
    return side_by_side(who, "category", "Strict accuracy by category", lambda one: one.summary.by_category)


def side_by_side(
    who: Sequence[Contender],
    name: str,
    title: str,
    groups: Callable[[Contender], Mapping[Any, GroupSummary]],
) -> Table:
    """Strict accuracy of each group of a grouping, a column for each contender."""
    names = sorted({group for one in who for group in groups(one)})
    found = [[str(group), *(_strict(groups(one).get(group)) for one in who)] for group in names]
    return Table(f"by_{name.replace(' ', '_')}", title, (name, *(one.label for one in who)), found)


def main_metrics(who: Sequence[Contender]) -> Table:
    """Accuracies, the Final Score, and what they took."""
    columns = ("agent", "episodes", "strict", "normalised", "Final Score", "iterations", "calls", "US$ per episode")
    found: list[list[Cell]] = []
    for one in who:
        cost = one.spending.cost_usd
        found.append(
            [
                one.label,
                one.whole.n_scored,
                _strict(one.whole),
                _normalised(one.whole),
                _score(one.whole),
                one.spending.iterations,
                one.spending.calls,
                None if cost is None else cost / one.spending.n_priced,
            ]
        )
    return Table("main_metrics", "Main metrics", columns, found, decimals=2)


def six_dimensions(who: Sequence[Contender]) -> Table:
    """C, E, G, V, R, G′ and the Final Score, means over episodes."""
    found = [
        [one.label, *(getattr(one.whole, name) for name in ("c", "e", "g", "v", "r", "g_prime")), _score(one.whole)]
        for one in who
    ]
    return Table("six_dimensions", "Six dimensions", ("agent", "C", "E", "G", "V", "R", "G′", "Final Score"), found)


def failure_modes(who: Sequence[Contender]) -> Table:
    """In how many scored episodes each failure mode shows."""
    found = [
        [mode.value.replace("_", " "), *(Count(one.whole.failures[mode].n, one.whole.n_scored) for one in who)]
        for mode in FailureMode
    ]
    return Table("failure_modes", "Failure modes", ("failure mode", *(one.label for one in who)), found)


def quoted() -> Table:
    """The paper's own figures, for context."""
    return Table(
        "paper_by_budget",
        "Accuracy by iteration budget as the paper prints it (measured on other scenes)",
        ("model", *map(str, BUDGETS)),
        [[one.model, *(Share(value / 100, None, None, None) for value in one.accuracy)] for one in PAPER],
    )


_GROUPS = ("easy-single", "easy-multi", "hard-single", "hard-multi")


def group_picks(who: Sequence[Contender]) -> list[tuple[str, Callable[[ScoredEpisode], bool] | None]]:
    """All episodes, and the four groups of categories as far as they are played."""
    played = {quadrant(row.category) for one in who for row in one.rows}

    def picks(group: str) -> Callable[[ScoredEpisode], bool]:
        return lambda row: quadrant(row.category) == group

    return [("all", None), *((group, picks(group)) for group in _GROUPS if group in played)]


def accuracies(
    rows: Sequence[ScoredEpisode],
    group: Callable[[ScoredEpisode], Any],
    wanted: Callable[[ScoredEpisode], bool] | None = None,
) -> dict[Any, Proportion]:
    """Strict accuracy of each group of the scored episodes that are wanted."""
    verdicts: dict[Any, list[tuple[int, bool]]] = {}
    for row in rows:
        if row.grade.strict is not Verdict.UNSCORED and (wanted is None or wanted(row)):
            right = row.grade.strict is Verdict.CORRECT
            verdicts.setdefault(group(row), []).append((row.episode.key.scene, right))
    return {name: proportion(verdicts[name]) for name in sorted(verdicts)}


def share_of(found: Proportion | None) -> Share | None:
    """A proportion as a cell."""
    return None if found is None else Share(found.share, found.interval.low, found.interval.high, found.n)


def _score(one: GroupSummary) -> Score | None:
    return None if one.final_score is None else Score(one.final_score)


def _strict(one: GroupSummary | None) -> Share | None:
    if one is None or one.strict_accuracy is None or one.strict_interval is None:
        return None
    return Share(one.strict_accuracy, one.strict_interval.low, one.strict_interval.high, one.n_scored)


def _normalised(one: GroupSummary) -> Share | None:
    if one.normalised_accuracy is None or one.normalised_interval is None:
        return None
    return Share(one.normalised_accuracy, one.normalised_interval.low, one.normalised_interval.high, one.n_scored)
