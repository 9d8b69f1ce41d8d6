"""Figures for papers and slides, drawn with matplotlib (the extra `report`). The HTML page does not need it."""

# matplotlib does not declare the types of its keyword arguments:
# pyright: reportUnknownMemberType=false

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evaluator.errors import StoreError, UsageError
from evaluator.report.agent_results import AgentResults
from evaluator.report.attachments import own_folder
from evaluator.report.tables import Share, Table, accuracies, by_category, group_picks
from evaluator.scores.dimensions import WEIGHTS
from evaluator.scores.failures.findings import FailureMode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#1f5fbf", "#b4541a", "#17703c", "#9c3587", "#7a6400", "#0b7285", "#b02a37", "#566070")
_LINES = ("-", "--", ":", "-.")


def write_figures(folder: Path, results: Sequence[AgentResults], form: str) -> list[Path]:
    """Draw the figures of a report and return their files.

    Args:
        folder: Folder to write to; made if missing.
        results: The results to show.
        form: `svg` or `pdf`.

    Raises:
        UsageError: matplotlib is not installed.
        StoreError: A file cannot be written.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise UsageError(
            "figures are drawn by matplotlib: install it with `pip install physment-mcp[report]`"
        ) from error
    settings: Any = {
        "svg.fonttype": "none",
        "svg.hashsalt": "physment",  # so that equal figures give equal files
        "pdf.fonttype": 42,
        "font.size": 9,
        "text.parse_math": False,  # so that matplotlib does not parse agent names as formulas
    }
    metadata: dict[str, str | None] = {"Date": None} if form == "svg" else {"CreationDate": None}
    written: list[Path] = []
    own_folder(folder)
    try:
        with mpl.rc_context(settings):
            for name, figure in _figures(results):
                written.append(folder / f"{name}.{form}")
                written[-1].unlink(missing_ok=True)  # it may be a symbolic link
                figure.savefig(written[-1], format=form, metadata=metadata, bbox_inches="tight")
    except OSError as error:
        raise StoreError(f"{folder} cannot be written: {error.strerror}") from error
    return written


def _figures(results: Sequence[AgentResults]) -> Iterator[tuple[str, "Figure"]]:
    results = [result for result in results if result.suite]
    if not results:
        return
    yield "budget", _budget(results)
    yield "categories", _matrix(by_category(results))
    yield "dimensions", _bars(results, ["C", "E", "G", "V", "R", "G′"], _dimensions, "mean, 0 to 1")
    modes = [mode.value.replace("_", " ") for mode in FailureMode]
    yield "failure_modes", _bars(results, modes, _failures, "share of scored episodes")


def _dimensions(result: AgentResults) -> list[float | None]:
    return [getattr(result.whole, name) for name in WEIGHTS]


def _failures(result: AgentResults) -> list[float | None]:
    n = result.whole.n_scored
    return [result.whole.failures[mode].n / n if n else None for mode in FailureMode]


def _panels(columns: int, width: float, height: float) -> tuple["Figure", list["Axes"]]:
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra; without pyplot it needs no display

    figure = Figure(figsize=(width * columns, height), layout="constrained")
    return figure, list(np.atleast_1d(np.asarray(figure.subplots(1, columns, sharey=True), dtype=object)))


def _budget(results: Sequence[AgentResults]) -> "Figure":
    """Accuracy against budget with 95 % intervals, one panel for each group of categories."""
    picks = group_picks(results)
    figure, panels = _panels(len(picks), 2.6, 2.8)
    budgets = sorted({row.key.budget for result in results for row in result.suite})
    apart = 0.012 * (max(budgets, default=0) - min(budgets, default=0))  # so that intervals do not cover each other
    for axes, (name, wanted) in zip(panels, picks, strict=True):
        for index, result in enumerate(results):
            cells = accuracies(result.suite, lambda row: row.key.budget, wanted)
            shares = [cell.share for cell in cells.values()]
            ends = [(cell.interval.low, cell.interval.high) for cell in cells.values()]
            axes.errorbar(
                [budget + apart * (index - (len(results) - 1) / 2) for budget in cells],
                [100 * share for share in shares],
                yerr=[
                    [100 * max(0.0, share - low) for share, (low, _) in zip(shares, ends, strict=True)],
                    [100 * max(0.0, high - share) for share, (_, high) in zip(shares, ends, strict=True)],
                ],
                label=result.label,
                color=_COLOURS[index % len(_COLOURS)],
                linestyle=_LINES[index % len(_LINES)],
                marker="o",
                markersize=3,
                linewidth=1.2,
                elinewidth=0.7,
            )
        axes.set(title=name, xlabel="iteration budget", ylim=(-3, 103))
        axes.set_xticks(budgets)
    panels[0].set_ylabel("strict accuracy [%]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _matrix(table: Table) -> "Figure":
    """Heat map of a table: rows against agents, coloured by accuracy."""
    figure, (axes,) = _panels(1, 2.2 + 0.9 * (len(table.columns) - 1), 1.2 + 0.32 * len(table.rows))
    values = [[cell.value if isinstance(cell, Share) else np.nan for cell in row[1:]] for row in table.rows]
    axes.imshow(np.array(values, dtype=float), cmap="Blues", vmin=0, vmax=1.8, aspect="auto")
    axes.set_xticks(range(len(table.columns) - 1), table.columns[1:], rotation=30, ha="right")
    axes.set_yticks(range(len(table.rows)), [str(row[0]) for row in table.rows])
    for y, row in enumerate(values):
        for x, value in enumerate(row):
            axes.text(x, y, "–" if np.isnan(value) else f"{100 * value:.0f}", ha="center", va="center")
    axes.set_title(f"{table.title} [%]")
    return figure


def _bars(
    results: Sequence[AgentResults],
    names: Sequence[str],
    values: Callable[[AgentResults], Sequence[float | None]],
    label: str,
) -> "Figure":
    """Grouped bar chart with one bar for each agent in each group."""
    figure, (axes,) = _panels(1, 7.0, 3.0)
    width = 0.8 / max(1, len(results))
    for index, result in enumerate(results):
        at = [place + width * (index - (len(results) - 1) / 2) for place in range(len(names))]
        heights = [value or 0.0 for value in values(result)]
        axes.bar(at, heights, width * 0.92, label=result.label, color=_COLOURS[index % len(_COLOURS)])
    axes.set_xticks(range(len(names)), names, rotation=20, ha="right")
    axes.set(ylabel=label, ylim=(0, 1))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure
