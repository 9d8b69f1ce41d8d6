"""`report.html`, from the episodes of one or several runs. Everything an agent wrote is escaped.

Up to 300 episodes the page is one file. Above that the notebooks stand beside it, a script each that hands over one
notebook when it is opened: pages opened from disk may not fetch files, but they may load scripts.
"""

import base64
import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.errors import StoreError
from evaluator.failures.findings import FailureMode
from evaluator.records import Outcome
from evaluator.report import tables
from evaluator.report.charts import Chart, Point, Series, chart
from evaluator.report.contenders import Contender, Run, contenders
from evaluator.report.export import shown
from evaluator.report.notebook import Entry, entries, laid_out, returned
from evaluator.scores.metrics import WEIGHTS
from evaluator.scores.spending import calls_made
from evaluator.scores.wording import curve_sentence, decimal, share
from evaluator.store import RunFolder

INLINE = 300
"""Episodes up to which a report is one file."""
PAGES = "report_episodes"
"""Folder beside the report that holds the notebooks of a larger one."""


@dataclass(frozen=True, slots=True)
class Report:
    """A report that is not written yet."""

    page: str
    """`report.html`."""
    notebooks: Iterator[str]
    """Scripts of the notebooks that are loaded when opened, from number 1 on; none in a report of one file."""


def write_report(folder: RunFolder, runs: Sequence[Run], inline: int = INLINE) -> Path:
    """Write `report.html` and, where there are many episodes, the notebooks beside it.

    Args:
        folder: Where to.
        runs: The runs, graded.
        inline: Episodes up to which it is one file.

    Returns:
        The page.

    Raises:
        StoreError: A file cannot be written.
    """
    report = render(runs, inline)
    try:
        _write_notebooks(folder.path / PAGES, report.notebooks)
    except OSError as error:
        raise StoreError(f"{folder.path / PAGES} cannot be written: {error.strerror}") from error
    folder.write_text(folder.report_file, report.page)
    return folder.report_file


def _write_notebooks(pages: Path, scripts: Iterable[str]) -> None:
    """Write the scripts as 1.js, 2.js …, and remove those of a larger report before."""
    written = 0
    for script in scripts:
        pages.mkdir(exist_ok=True)
        written += 1
        (pages / f"{written}.js").write_text(script, encoding="utf-8")
    for stale in pages.glob("*.js"):
        if stale.stem.isdecimal() and int(stale.stem) > written:
            stale.unlink()
    if pages.is_dir() and not any(pages.iterdir()):
        pages.rmdir()


def render(runs: Sequence[Run], inline: int = INLINE) -> Report:
    """The report of some runs."""
    environment = _environment()
    who = contenders(runs)
    found = list(entries(who))
    beside = len(found) > inline
    script = environment.get_template("report.js").render()
    picks = tables.group_picks(who)
    page = environment.get_template("page.html.j2").render(
        runs=runs,
        who=who,
        weights=WEIGHTS,
        entries=found,
        beside=PAGES if beside else "",
        budget_tables=[(name, tables.by_budget(who, name, wanted)) for name, wanted in picks],
        budget_charts=_budget_charts(who),
        heat=tables.by_category(who),
        groupings=_groupings(who),
        modes=list(FailureMode),
        outcomes=list(Outcome),
        quoted=tables.quoted(),
        graders=sorted({one.grader_version for run in runs for one in run.grades.values()}),
        title=_title(who),
        differing=_differing(runs),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    return Report(page, _scripts(environment, found) if beside else iter(()))


def _scripts(environment: Environment, found: Sequence[Entry]) -> Iterator[str]:
    """A script for each notebook: one call with its number and its HTML."""
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


def _title(who: Sequence[Contender]) -> str:
    names = [one.label for one in who]
    return ", ".join(names if len(names) <= 4 else [*names[:3], f"{len(names) - 3} more"])


def _differing(runs: Sequence[Run]) -> str:
    """The runs by what they were played on, if two played different packs of one scene."""
    played: list[tuple[dict[str, str], list[str]]] = []
    for run in runs:
        packs = run.record.packs
        for known, names in played:
            if all(known.get(scene, one) == one for scene, one in packs.items()):
                known.update(packs)
                names.append(run.name)
                break
        else:
            played.append((dict(packs), [run.name]))
    return "" if len(played) < 2 else "; ".join(" and ".join(names) for _, names in played)


def _budget_charts(who: Sequence[Contender]) -> list[Chart]:
    """Accuracy against budget, of all episodes and of each group of categories; none with a single budget."""
    budgets = sorted({row.episode.key.budget for one in who for row in one.rows})
    if len(budgets) < 2:
        return []
    charts: list[Chart] = []
    for name, wanted in tables.group_picks(who):
        series: list[Series] = []
        for one in who:
            cells = tables.accuracies(one.rows, lambda row: row.episode.key.budget, wanted)
            points = [
                Point(budget, cell.share, cell.interval.low, cell.interval.high) for budget, cell in cells.items()
            ]
            series.append(Series(one.label, [points]))
        if any(segment for one in series for segment in one.segments):
            charts.append(chart(name, series, size=(320, 200), x_ticks=budgets, y_range=(0, 1), dodge=3, percent=True))
    return charts


def _groupings(who: Sequence[Contender]) -> list[tables.Table]:
    """Strict accuracy side by side, for each other grouping that has several groups."""
    found = [
        tables.side_by_side(who, "group", "Easy or hard, single or multi", lambda one: one.summary.by_quadrant),
        tables.side_by_side(who, "modality", "Modality", lambda one: one.summary.by_modality),
        tables.side_by_side(who, "kind", "Qualitative or quantitative", lambda one: one.summary.by_problem_kind),
        tables.side_by_side(who, "problem type", "Problem type", lambda one: one.summary.by_problem_type),
    ]
    return [one for one in found if len(one.rows) > 1]


def _score(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _compact(value: object) -> str:
    return "–" if value is None else json.dumps(value, ensure_ascii=False)


def _brief(value: object) -> str:
    """An answer in a line of the list: six digits of a float, eighty characters of anything."""
    rounded = json.loads(json.dumps(value), parse_float=lambda text: float(f"{float(text):.6g}"))
    text = _compact(rounded)
    return text if len(text) <= 80 else f"{text[:79]}…"


def _words(value: str) -> str:
    return value.replace("_", " ")


def _options(values: Iterable[object]) -> list[tuple[object, str]]:
    return [(value, _words(str(value))) for value in values]


_FILTERS: dict[str, Any] = {
    "curve_sentence": curve_sentence,
    "share": share,
    "decimal": decimal,
    "score": _score,
    "compact": _compact,
    "brief": _brief,
    "words": _words,
    "options": _options,
    "shown": shown,
    "laid_out": laid_out,
    "returned": returned,
    "calls_made": calls_made,
}
