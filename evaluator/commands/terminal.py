"""Terminal output of a run: progress with accuracy, cost and pace, the final results, and tables of evidence."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from pydantic import JsonValue
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from evaluator.answers.keys import KeyRing
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict
from evaluator.records.evidence import EvidenceVerdict
from evaluator.scores.metrics import GroupSummary, RunSummary, summarise
from evaluator.scores.scored_episode import EvidenceSummary, ScoredEpisode, law_sentence, scene_title
from evaluator.scores.scoring import GradedRun, strict_verdict
from evaluator.scores.wording import (
    ability_sentence,
    curve_sentence,
    decimal,
    dimension,
    floor_sentence,
    score_text,
    share,
    withdrawn_clause,
)
from evaluator.study.meter import Meter
from scenes import Rung, reference_of


@dataclass(slots=True)
class Tally:
    """Grades episodes as they end, for the display only. The recorded verdicts are computed after the run."""

    keys: KeyRing
    meter: Meter
    agents: Sequence[str]
    """Names of all agents of the run. Accuracies of several agents are never pooled."""
    clock: Callable[[], float] = time.monotonic
    ended: int = 0
    scored: Counter[str] = field(default_factory=Counter[str])
    """Number of scored episodes of each agent."""
    correct: Counter[str] = field(default_factory=Counter[str])
    """Number of correctly answered episodes of each agent."""
    started: float = field(init=False)

    def __post_init__(self) -> None:
        self.started = self.clock()

    def add(self, episode: Episode) -> Verdict:
        """Count an episode that has just ended, and return its verdict."""
        verdict = strict_verdict(episode, self.keys)
        self.ended += 1
        self.scored[episode.key.agent] += verdict is not Verdict.UNSCORED
        self.correct[episode.key.agent] += verdict is Verdict.CORRECT
        return verdict

    def line(self, agent: str) -> str:
        """One line with the state of the run.

        Args:
            agent: Agent whose correct answers are shown. The line names it if the run has several agents.
        """
        minutes = max(self.clock() - self.started, 1e-9) / 60
        named = f"{agent} " if len(self.agents) > 1 else ""
        parts = [f"{named}{self.correct[agent]}/{self.scored[agent]} right"] if self.scored[agent] else []
        if self.meter.tokens:
            parts.append(f"{self.meter.tokens / 1000:.0f} k tokens")
        if self.meter.cost_usd:
            parts.append(f"${self.meter.cost_usd:.2f}")
        if self.ended:
            parts.append(f"{self.ended / minutes:.0f} episodes/min")
        return " · ".join(parts)


_MARKS = {Verdict.CORRECT: "[green]✓[/]", Verdict.INCORRECT: "[red]✗[/]", Verdict.UNSCORED: "[yellow]–[/]"}
_MOST_ROWS = 120
"""Largest number of episodes that are listed individually in the terminal."""
_WIDE = 100
"""Smallest width of a terminal at which scene names are not wrapped at 16 characters and the progress shows them."""


class ProgressDisplay:
    """Shows the progress of a run: a bar on a terminal, otherwise a line for each finished episode."""

    def __init__(self, console: Console, total: int, tally: Tally) -> None:
        self._console = console
        self._total = total
        self._tally = tally
        self._done = 0
        self._narrow = console.width < _WIDE
        # A narrow terminal has no room for everything, and rich would cut the times and the counts.
        columns = (MofNCompleteColumn(),) if self._narrow else (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._bar = Progress(
            TextColumn("{task.description}"),
            *columns,
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
        """Show the episode that has just started."""
        scene = reference_of(key.scene) if self._narrow else self._title(key.scene)
        self._bar.update(self._task, description=f"scene {scene}, seed {key.seed}")

    def ended(self, episode: Episode) -> None:
        """Count a finished episode, and show the results so far."""
        self._done += 1
        verdict, key = self._tally.add(episode), episode.key
        state = printable(self._tally.line(key.agent))
        self._bar.update(self._task, advance=1, state=state)
        named = f"{printable(key.agent)}, " if len(self._tally.agents) > 1 else ""
        what = _describe(episode, self._title(key.scene))
        line = f"[{self._done}/{self._total}] {named}{what}: {verdict.value} ({state})"
        if episode.outcome is Outcome.INFRASTRUCTURE_ERROR:
            self._console.print(f"{line}: {printable(episode.error or '')}", markup=False, highlight=False)
        elif not self._console.is_terminal:
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def _title(self, scene: int) -> str:
        try:
            return printable(scene_title(scene, self._tally.keys.facts(scene).name))
        except UsageError:  # a pack that only the host has
            return reference_of(scene)


def _describe(episode: Episode, title: str) -> str:
    key = episode.key
    what = episode.outcome.value.replace("_", " ")
    turns = "iterations" if episode.max_calls is None else "calls"
    return (
        f"scene {title}, seed {key.seed}, budget {key.budget}: {what} after"
        f" {len(episode.turns)} {turns}, {episode.duration_s:.1f} s"
    )


def print_results(console: Console, graded: GradedRun) -> None:
    """Print the results of a run: one row for each episode unless there are many, then the totals."""
    if len(graded.rows) <= _MOST_ROWS:
        console.print(_episode_table(graded.rows, narrow=console.width < _WIDE))
    for line in summary_lines(graded.summary, graded.rows):
        console.print(line, highlight=False, soft_wrap=True)


def _episode_table(rows: Sequence[ScoredEpisode], *, narrow: bool) -> Table:
    """Table with a row for each episode. Agents, budgets and outcomes have a column only if there are several."""
    table = Table(box=None, pad_edge=False)
    agents, budgets = (len({getattr(row.key, part) for row in rows}) > 1 for part in ("agent", "budget"))
    outcomes = {row.episode.outcome for row in rows} != {Outcome.ANSWERED}
    if agents:
        table.add_column("agent", overflow="fold")
    table.add_column("scene", overflow="fold", max_width=16 if narrow else None)
    for title in ("seed", *(["budget"] if budgets else []), "iterations"):
        table.add_column(title, justify="right")
    for title in (*(["outcome"] if outcomes else []), "answer", "", "reason"):
        table.add_column(title, overflow="fold", min_width={"answer": 16, "reason": 12}.get(title))
    for row in sorted(rows, key=lambda row: (row.key.scene, row.key.seed, row.key.budget, row.key.agent)):
        key, episode, grade = row.key, row.episode, row.grade
        table.add_row(
            *([Text(printable(key.agent))] if agents else []),
            Text(printable(row.scene_title)),
            str(key.seed),
            *([str(key.budget)] if budgets else []),
            str(len(episode.turns)),
            *([episode.outcome.value] if outcomes else []),
            Text(printable(_short(episode.answer))),
            _MARKS[grade.strict],
            Text(printable(episode.error or ("" if row.is_correct else grade.reason))),
        )
    return table


def printable(text: str, keep: str = "") -> str:
    """Escape the control characters in text of an agent or a server, because terminals interpret them.

    Args:
        text: Untrusted text.
        keep: Control characters that are not escaped.
    """
    return "".join(
        character if character.isprintable() or character in keep else character.encode("unicode_escape").decode()
        for character in text
    )


def _short(answer: JsonValue) -> str:
    if isinstance(answer, float):
        return f"{answer:.5g}"
    if isinstance(answer, list):
        return ", ".join(_short(part) for part in answer)
    return "" if answer is None else str(answer)[:60]


def summary_lines(summary: RunSummary, rows: Iterable[ScoredEpisode]) -> list[str]:
    """Lines with the totals of a run: first of the suite, then of open worlds.

    Args:
        summary: Summary of the run.
        rows: Scored episodes of the run, needed because the summary pools agents in open worlds.
    """
    lines = _suite_lines(summary) if summary.overall.n or Rung.OPEN not in summary.by_rung else []
    played = [row for row in rows if row.is_open]
    agents = sorted({row.key.agent for row in played})
    for agent in agents:
        group = summarise([row for row in played if row.key.agent == agent]).by_rung[Rung.OPEN]
        named = f"{agent}: " if len(agents) > 1 or len(summary.by_agent) > 1 else ""
        lines += [f"{named}{line}" for line in _open_lines(group)]
    return [*lines, *map(ability_sentence, summary.abilities), *_errata_lines(summary)]


def _errata_lines(summary: RunSummary) -> list[str]:
    """One line for each known fault of a pack that was played."""
    return [
        f"{found.erratum.effect.value}: scene {reference_of(found.erratum.scene)} as pack {found.erratum.pack},"
        f" {found.n} episode{'' if found.n == 1 else 's'}: {found.erratum.fault}"
        for found in summary.errata
    ]


def _open_lines(group: GroupSummary) -> list[str]:
    right = f"open worlds: all predictions right {_right(group)}, predictions right {share(group.c)}"
    laws = [law_sentence(group.laws)] if group.laws is not None and group.laws.stated else []
    return [right, *laws, _cost(group), _outcomes(group)]


def _right(group: GroupSummary) -> str:
    withdrawn = withdrawn_clause(group)
    return f"{share(group.strict_accuracy)} ({group.n_correct}/{group.n_scored}{withdrawn and f'; {withdrawn}'})"


def _cost(group: GroupSummary) -> str:
    cost = group.experiment_cost
    if cost.calls is None or cost.lab_time_s is None:
        return "cost of experiment –"
    return f"cost of experiment (medians): calls {cost.calls:g}, lab time {cost.lab_time_s:.4g} s"


def _outcomes(group: GroupSummary) -> str:
    return "   ".join(f"{outcome.value} {count}" for outcome, count in group.outcomes.items())


def _suite_lines(summary: RunSummary) -> list[str]:
    """Lines with the totals of the suite, separately for each agent."""
    if len(summary.by_agent) > 1:
        lines = [f"{agent}: {line}" for agent, group in summary.by_agent.items() for line in _group_lines(group)]
        return [*lines, *_curve_lines(summary)]
    lines = _group_lines(summary.overall)
    budgets = {str(budget): group for budget, group in summary.by_budget.items()}
    rungs = {name: group for name, group in summary.by_rung.items() if name != Rung.OPEN}
    split = [
        f"by {name}  " + "   ".join(f"{part}: {_right(group)}" for part, group in groups.items())
        for name, groups in (("budget", budgets), ("rung", rungs))
        if len(groups) > 1
    ]
    return [lines[0], *split, *_curve_lines(summary), *lines[1:]]


def _curve_lines(summary: RunSummary) -> list[str]:
    several = len(summary.budget_curves) > 1
    return [
        (f"{played.agent}, {played.prompting}, {played.protocol}: " if several else "") + curve_sentence(played.curve)
        for played in summary.budget_curves
    ]


def _group_lines(group: GroupSummary) -> list[str]:
    accuracy = f"strict accuracy {_right(group)}"
    if group.strict_interval is not None:
        accuracy += f", 95 % interval {share(group.strict_interval.low)} to {share(group.strict_interval.high)}"
    accuracy += f"; normalised accuracy {share(group.normalised_accuracy)}"
    names = {"C": "c", "E": "e", "G": "g", "G+": "g_plus", "V": "v", "R": "r", "G′": "g_prime"}
    parts = [f"{title} {dimension(group, name)}" for title, name in names.items()]
    scores = {"Final Score": group.final_score, "FS*": group.final_score_of_defined}
    parts += [f"{name} {score_text(value)}" for name, value in scores.items()]
    return [accuracy, "   ".join(parts), _floors(group), _cost(group), _outcomes(group)]


def _floors(group: GroupSummary) -> str:
    """Return a clause with Skill and Gated, and their values for an agent that only guesses."""
    skill = f"Skill {decimal(group.skill)}"
    if group.skill_interval is not None:
        ends = (group.skill_interval.low, group.skill_interval.high)
        skill += f", 95 % interval {decimal(ends[0])} to {decimal(ends[1])}"
    parts = [skill, f"Gated {score_text(group.gated)}", floor_sentence({"": group})]
    return "   ".join(filter(None, parts))


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
