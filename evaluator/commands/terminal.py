"""What a person sees of a run in the terminal: a progress bar or plain lines, and the table at the end."""

from types import TracebackType
from typing import Self

from pydantic import JsonValue
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from evaluator.records import Episode, EpisodeKey, GradeRecord, Outcome, Verdict
from evaluator.scores.metrics import RunSummary
from evaluator.scores.wording import curve_sentence, decimal, share
from evaluator.study.tally import Tally

_MARKS = {Verdict.CORRECT: "[green]✓[/]", Verdict.INCORRECT: "[red]✗[/]", Verdict.UNSCORED: "[yellow]–[/]"}


class ProgressDisplay:
    """A bar on a terminal, a line for each finished episode otherwise."""

    def __init__(self, console: Console, total: int, tally: Tally) -> None:
        self._console = console
        self._total = total
        self._tally = tally
        self._done = 0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[state]}"),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._bar.add_task("playing", total=total, state="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bar.stop()

    def started(self, key: EpisodeKey) -> None:
        """Show which episode is being played."""
        self._bar.update(self._task, description=f"scene {key.scene} seed {key.seed}")

    def ended(self, episode: Episode) -> None:
        """Count a finished episode, and show how the run stands."""
        self._done += 1
        verdict = self._tally.add(episode)
        self._bar.update(self._task, advance=1, state=self._tally.line())
        line = f"[{self._done}/{self._total}] {_describe(episode)}: {verdict.value} ({self._tally.line()})"
        if episode.outcome is Outcome.INFRASTRUCTURE_ERROR:
            self._console.print(f"{line}: {_harmless(episode.error or '')}", markup=False, highlight=False)
        elif not self._console.is_terminal:
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)


def _describe(episode: Episode) -> str:
    key = episode.key
    what = episode.outcome.value.replace("_", " ")
    turns = "iterations" if episode.max_calls is None else "calls"
    return (
        f"scene {key.scene} seed {key.seed} budget {key.budget}: {what} after {len(episode.turns)} {turns},"
        f" {episode.duration_s:.1f} s"
    )


def print_results(
    console: Console, episodes: dict[EpisodeKey, Episode], grades: dict[EpisodeKey, GradeRecord], summary: RunSummary
) -> None:
    """The results: a row for each episode (for each category where there are many), then the totals."""
    if len(episodes) <= 120:
        console.print(_episode_table(episodes, grades))
    for line in summary_lines(summary):
        console.print(line, highlight=False, soft_wrap=True)


def _episode_table(episodes: dict[EpisodeKey, Episode], grades: dict[EpisodeKey, GradeRecord]) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in ("scene", "seed", "budget", "iterations"):
        table.add_column(title, justify="right")
    for title in ("outcome", "answer", "", "reason"):
        table.add_column(title, overflow="fold")
    for key, episode in sorted(episodes.items(), key=lambda item: (item[0].scene, item[0].seed, item[0].budget)):
        grade = grades[key].grade
        table.add_row(
            str(key.scene),
            str(key.seed),
            str(key.budget),
            str(len(episode.turns)),
            episode.outcome.value,
            Text(_harmless(_short(episode.answer))),
            _MARKS[grade.strict],
            Text(_harmless(episode.error or ("" if grade.strict is Verdict.CORRECT else grade.reason))),
        )
    return table


def _harmless(text: str) -> str:
    """Text of an agent or a server for a terminal, which would obey its control characters."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def _short(answer: JsonValue) -> str:
    if isinstance(answer, float):
        return f"{answer:.5g}"
    if isinstance(answer, list):
        return ", ".join(_short(part) for part in answer)
    return "" if answer is None else str(answer)[:60]


def summary_lines(summary: RunSummary) -> list[str]:
    """The totals of a run, a line each."""
    whole = summary.overall
    lines = [f"strict accuracy {share(whole.strict_accuracy)} ({whole.n_correct}/{whole.n_scored})"]
    if whole.strict_interval is not None:
        lines[0] += f", 95 % interval {share(whole.strict_interval.low)} to {share(whole.strict_interval.high)}"
    lines[0] += f"; normalised accuracy {share(whole.normalised_accuracy)}"
    if len(summary.by_budget) > 1:
        parts = (
            f"{budget}: {share(one.strict_accuracy)} ({one.n_correct}/{one.n_scored})"
            for budget, one in summary.by_budget.items()
        )
        lines.append("by budget  " + "   ".join(parts))
    for one in summary.budget_curves:
        who = f"{one.agent}, {one.prompting}, {one.protocol}: " if len(summary.budget_curves) > 1 else ""
        lines.append(who + curve_sentence(one.curve))
    dimensions = (("C", whole.c), ("E", whole.e), ("G", whole.g), ("V", whole.v), ("R", whole.r), ("G′", whole.g_prime))
    score = "–" if whole.final_score is None else f"{whole.final_score:.1f}"
    lines.append("   ".join(f"{name} {decimal(value)}" for name, value in dimensions) + f"   Final Score {score}")
    lines.append("   ".join(f"{outcome.value} {count}" for outcome, count in whole.outcomes.items()))
    return lines
