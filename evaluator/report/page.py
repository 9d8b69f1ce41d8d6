"""`report.html`: one self-contained page, from the rows of a run. Everything an agent wrote is escaped."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.display import decimal, share
from evaluator.metrics import WEIGHTS, GroupSummary, ScoredEpisode, summarise
from evaluator.records import EpisodeKey, GradeRecord
from evaluator.report.notebook import calls_made, entries, laid_out, returned
from evaluator.store import RunFolder


def write_report(
    folder: RunFolder, facts: Mapping[str, Any], rows: Sequence[ScoredEpisode], grades: Mapping[EpisodeKey, GradeRecord]
) -> None:
    """Write the report of a run.

    Args:
        folder: The run folder.
        facts: What `run.json` holds.
        rows: Its episodes, graded.
        grades: Their grades with the keys they were graded against.

    Raises:
        StoreError: The file cannot be written.
    """
    folder.write_text(folder.report_file, render(facts, rows, grades))


def render(facts: Mapping[str, Any], rows: Sequence[ScoredEpisode], grades: Mapping[EpisodeKey, GradeRecord]) -> str:
    """The page as HTML."""
    summary = summarise(rows)
    groups: list[tuple[str, Mapping[Any, GroupSummary]]] = [
        ("Category", summary.by_category),
        ("Easy or hard, single or multi", summary.by_quadrant),
        ("Problem type", summary.by_problem_type),
    ]
    if len(summary.by_budget) > 1:
        groups.append(("Iteration budget", summary.by_budget))
    environment = Environment(
        loader=PackageLoader("evaluator.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(_FILTERS)
    script = environment.get_template("filter.js").render()
    return environment.get_template("page.html.j2").render(
        facts=facts,
        summary=summary,
        whole=summary.overall,
        groups=groups,
        weights=WEIGHTS,
        entries=entries(rows, grades),
        graders=sorted({one.grader_version for one in grades.values()}),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _score(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _compact(value: object) -> str:
    return "–" if value is None else json.dumps(value, ensure_ascii=False)


_FILTERS: dict[str, Any] = {
    "share": share,
    "decimal": decimal,
    "score": _score,
    "compact": _compact,
    "laid_out": laid_out,
    "returned": returned,
    "calls_made": calls_made,
}
