"""`report.html`: one self-contained page, from the rows of a run. Everything an agent wrote is escaped."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.display import decimal, share
from evaluator.metrics import EpisodeScores, GroupSummary, ScoredEpisode, dimensions, summarise
from evaluator.records import EpisodeKey, GradeRecord
from evaluator.store import RunFolder


@dataclass(frozen=True, slots=True)
class _Entry:
    """An episode as the page shows it."""

    row: ScoredEpisode
    record: GradeRecord
    scores: EpisodeScores

    @property
    def label(self) -> str:
        key = self.row.episode.key
        return f"Scene {key.scene}, seed {key.seed}, budget {key.budget}, epoch {key.epoch}"


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
    entries = [
        _Entry(row, grades[row.episode.key], dimensions(row.episode, row.grade, row.disabled_tools)) for row in rows
    ]
    entries.sort(key=lambda entry: (entry.row.episode.key.scene, entry.row.episode.key.seed, entry.label))
    groups: list[tuple[str, Mapping[Any, GroupSummary]]] = [
        ("Category", summary.by_category),
        ("Difficulty and breadth", summary.by_quadrant),
        ("Problem type", summary.by_problem_type),
        ("Iteration budget", summary.by_budget),
    ]
    environment = Environment(
        loader=PackageLoader("evaluator.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters |= {"share": share, "decimal": decimal, "json": _json, "compact": _compact}
    return environment.get_template("page.html.j2").render(
        facts=facts, summary=summary, whole=summary.overall, groups=groups, entries=entries
    )


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, indent=2)


def _compact(value: object) -> str:
    return "–" if value is None else json.dumps(value, ensure_ascii=False)
