"""Renders `report.html` from the episodes of one or several runs. All text from agents is escaped.

With up to 300 episodes, the page is a single file. With more, the notebook of each episode is a separate script in a
folder beside the page, loaded when the reader opens the episode. Browsers let a page that was opened from disk load
scripts but not fetch files.
"""

import base64
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.errors import StoreError
from evaluator.records.episode import Outcome
from evaluator.records.evidence import EvidenceVerdict
from evaluator.report import tables
from evaluator.report.agent_results import AgentResults, Run, agent_results, packs_of
from evaluator.report.agent_tables import BUCKETS, abilities_table, bucket, errata_table, laws_table, verdict_grid
from evaluator.report.attachments import own_folder, write_anew, write_player
from evaluator.report.baselines import baseline_table
from evaluator.report.call_rows import is_long
from evaluator.report.charts import Chart, Point, Series, chart
from evaluator.report.evidence import NOT_MEASURABLE, PLANE, evidence_table, planes
from evaluator.report.export import shown
from evaluator.report.notebook import Entry, entries, laid_out, question, returned
from evaluator.scores.dimensions import WEIGHTS
from evaluator.scores.failures.findings import FailureMode
from evaluator.scores.spending import Spending, calls_made, spending
from evaluator.scores.wording import counted, curve_sentence, decimal, score_text, share
from evaluator.statistics.paired import BudgetCurve
from evaluator.store.run_folder import RunFolder
from scenes import reference_of

INLINE = 300
"""Largest number of episodes of a report that is a single file."""
PAGES = "report_episodes"
"""Name of the folder of notebooks, beside the page of a larger report."""


@dataclass(frozen=True, slots=True)
class Report:
    """The rendered files of a report."""

    page: str
    """Content of `report.html`."""
    notebooks: Iterator[str]
    """Scripts of the notebooks in the order of their numbers; empty if the report is a single file."""


def write_report(
    folder: RunFolder,
    runs: Sequence[Run],
    inline: int = INLINE,
    *,
    baselines: bool = True,
    follow: Callable[[Iterator[str]], Iterable[str]] = iter,
) -> Path:
    """Write `report.html` and, if there are more than `inline` episodes, the notebooks beside it.

    Args:
        folder: Folder to write to.
        runs: The graded runs.
        inline: Largest number of episodes of a report that is a single file.
        baselines: Whether to show the baselines that ship with the package.
        follow: Function that wraps the iterator of notebook scripts, for example to show a progress bar.

    Returns:
        Path of the page.

    Raises:
        StoreError: A file cannot be written.
    """
    report = render(runs, inline, baselines=baselines)
    try:
        _write_notebooks(folder.path / PAGES, follow(report.notebooks))
    except OSError as error:
        raise StoreError(f"{folder.path / PAGES} cannot be written: {error.strerror}") from error
    if any(run.attachments.films for run in runs):
        write_player(folder.path)
    folder.write_text(folder.report_file, report.page)
    return folder.report_file


def _write_notebooks(pages: Path, scripts: Iterable[str]) -> None:
    """Write the scripts as 1.js, 2.js …, and remove further scripts of an earlier, larger report."""
    written = 0
    for script in scripts:
        written += 1
        write_anew(own_folder(pages) / f"{written}.js", script.encode("utf-8"))
    if pages.is_symlink():
        return
    for stale in pages.glob("*.js"):
        if stale.stem.isdecimal() and int(stale.stem) > written:
            stale.unlink()
    if pages.is_dir() and not any(pages.iterdir()):
        pages.rmdir()


def render(runs: Sequence[Run], inline: int = INLINE, *, baselines: bool = True) -> Report:
    """Render the report of runs; for the arguments see `write_report`."""
    environment = _environment()
    results = agent_results(runs)
    found = list(entries(results))
    beside = len(found) > inline
    script = environment.get_template("report.js").render()
    suite = [result for result in results if result.suite]
    picks = tables.group_picks(suite)
    page = environment.get_template("page.html.j2").render(
        runs=runs,
        results=results,
        suite=suite,
        weights=WEIGHTS,
        baselines=baseline_table(packs_of(suite)) if baselines else None,
        floors=tables.floors(suite),
        abilities=abilities_table(results),
        errata=errata_table(results),
        dimensions=tuple(tables.DIMENSIONS.values()),
        entries=found,
        grid=verdict_grid(found, len(results)),
        beside=PAGES if beside else "",
        budget_tables=[(name, tables.by_budget(suite, name, wanted)) for name, wanted in picks],
        budget_charts=_budget_charts(suite),
        heat=tables.by_category(suite),
        groupings=_groupings(suite),
        forgiven=tables.forgiven(suite),
        rungs=tables.by_rung(results),
        experiment_cost=tables.experiment_cost(results),
        spent=list(_spent(results)),
        modes=list(FailureMode),
        laws=laws_table(results),
        evidence=evidence_table(results),
        evidence_verdicts=[*EvidenceVerdict, NOT_MEASURABLE],
        planes=planes(results, ((entry.number, entry.agent_index, entry.row) for entry in found)),
        plane_size=PLANE,
        outcomes=list(Outcome),
        quoted=tables.quoted(),
        graders=sorted({row.record.grader_version for run in runs for row in run.rows}),
        title=_title(results),
        differing=_differing(runs),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    return Report(page, _scripts(environment, found) if beside else iter(()))


def paper_page(title: str, found: Sequence[tables.Table]) -> str:
    """Render the page with the paper's tables.

    Args:
        title: Name of the run.
        found: The tables to show.
    """
    template = _environment().get_template("paper.html.j2")
    return template.render(title=title, found=found, buckets=BUCKETS, bucket=bucket, shown=shown)


def _scripts(environment: Environment, found: Sequence[Entry]) -> Iterator[str]:
    """Render one script for each notebook: a function call with the notebook's number and HTML."""
    template = environment.get_template("notebook.html.j2").module
    for entry in found:
        html = str(template.notebook(entry))  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownArgumentType] - a macro
        yield f"physmentNotebook({entry.number}, {json.dumps(html)});\n"


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("evaluator.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(_FILTERS)
    return environment


def _title(results: Sequence[AgentResults]) -> str:
    names = [result.label for result in results]
    return ", ".join(names if len(names) <= 4 else [*names[:3], f"{len(names) - 3} more"])


def _differing(runs: Sequence[Run]) -> str:
    """The names of the runs, grouped by the packs they played; empty if every scene was played on a single pack."""
    played: list[tuple[dict[str, str], list[str]]] = []
    for run in runs:
        packs = run.record.content_hashes()
        for known, names in played:
            if all(known.get(scene, pack) == pack for scene, pack in packs.items()):
                known.update(packs)
                names.append(run.name)
                break
        else:
            played.append((dict(packs), [run.name]))
    return "" if len(played) < 2 else "; ".join(" and ".join(names) for _, names in played)


def _budget_charts(results: Sequence[AgentResults]) -> list[Chart]:
    """Accuracy against budget, one chart for each group of categories; no chart if there is a single budget."""
    budgets = sorted({row.key.budget for result in results for row in result.suite})
    if len(budgets) < 2:
        return []
    charts: list[Chart] = []
    for name, wanted in tables.group_picks(results):
        series: list[Series] = []
        for result in results:
            cells = tables.accuracies(result.suite, lambda row: row.key.budget, wanted)
            points = [
                Point(budget, cell.share, cell.interval.low, cell.interval.high) for budget, cell in cells.items()
            ]
            series.append(Series(result.label, [points]))
        if any(segment for line in series for segment in line.segments):
            charts.append(chart(name, series, size=(320, 200), x_ticks=budgets, y_range=(0, 1), dodge=3, percent=True))
    return charts


def _spent(results: Sequence[AgentResults]) -> Iterator[tuple[str, Spending]]:
    """Label and spending of each agent, separately for the suite and for open worlds."""
    for result in results:
        if result.suite:
            yield result.label, result.spending
        if result.open_worlds:
            yield f"{result.label}, open worlds", spending(result.open_worlds)


def _groupings(results: Sequence[AgentResults]) -> list[tables.Table]:
    """Tables of strict accuracy, one for each grouping of scenes. Groupings with a single group are omitted."""
    found = [
        tables.side_by_side(
            results, "group", "Easy or hard, single or multi", lambda result: result.summary.by_quadrant
        ),
        tables.side_by_side(results, "modality", "Modality", lambda result: result.summary.by_modality),
        tables.side_by_side(
            results, "kind", "Qualitative or quantitative", lambda result: result.summary.by_problem_kind
        ),
        tables.side_by_side(results, "problem type", "Problem type", lambda result: result.summary.by_problem_type),
    ]
    return [table for table in found if len(table.rows) > 1]


def _compact(value: object) -> str:
    return "–" if value is None else json.dumps(value, ensure_ascii=False)


def _brief(value: object) -> str:
    """Format an answer for the list of episodes: floats with six digits, at most 80 characters in all."""
    rounded = json.loads(json.dumps(value), parse_float=lambda text: float(f"{float(text):.6g}"))
    text = _compact(rounded)
    return text if len(text) <= 80 else f"{text[:79]}…"


def _words(value: str) -> str:
    return value.replace("_", " ")


def _unbroken(text: str) -> str:
    """Keep each number and its per cent sign on one line."""
    return text.replace(" %", "\N{NO-BREAK SPACE}%")


def _share(value: float | None) -> str:
    return _unbroken(share(value))


def _curve_sentence(curve: BudgetCurve) -> str:
    return _unbroken(curve_sentence(curve))


def _options(values: Iterable[object]) -> list[tuple[object, str]]:
    return [(value, _words(str(value))) for value in values]


def _scene_options(found: Iterable[Entry]) -> list[tuple[int, str]]:
    """Ids and titles of the scenes of some episodes, sorted by id."""
    return sorted({entry.row.key.scene: entry.row.scene_title for entry in found}.items())


_FILTERS: dict[str, Any] = {
    "curve_sentence": _curve_sentence,
    "share": _share,
    "decimal": decimal,
    "score": score_text,
    "counted": counted,
    "compact": _compact,
    "brief": _brief,
    "words": _words,
    "options": _options,
    "scene_options": _scene_options,
    "scene_name": reference_of,
    "shown": shown,
    "laid_out": laid_out,
    "returned": returned,
    "question": question,
    "calls_made": calls_made,
    "is_long": is_long,
}
