"""Tables as Markdown, CSV and LaTeX. Whatever an agent is called, it stays text."""

import csv
import io
import re
from collections.abc import Sequence

from evaluator.report.tables import Cell, Count, Score, Share, Table

_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "′": r"$'$",
    "–": "--",
    **{one: f"\\{one}" for one in "$%&#_"},
}
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")


def markdown(tables: Sequence[Table]) -> str:
    """GitHub-flavoured Markdown, a heading above each table."""
    parts: list[str] = []
    for table in tables:
        lines = [f"## {table.title}", "", _markdown_row(table.columns)]
        lines.append("|---|" + "---:|" * (len(table.columns) - 1))
        lines += [_markdown_row([shown(cell, table.decimals) for cell in row]) for row in table.rows]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _markdown_row(cells: Sequence[str]) -> str:
    escaped = (re.sub(r"([\\`*_{}\[\]<>|#])", r"\\\1", _plain(cell)) for cell in cells)
    return "| " + " | ".join(escaped) + " |"


def latex(tables: Sequence[Table]) -> str:
    r"""`tabular`s with the rules of `booktabs`, each in a `table` with caption and label."""
    parts = ["% Needs \\usepackage{booktabs}.\n"]
    for table in tables:
        head, *rows = ([*table.columns], *([shown(cell, table.decimals) for cell in row] for row in table.rows))
        body = "".join(_latex_row(row) for row in rows)
        parts.append(
            f"\\begin{{table}}\n  \\centering\n  \\caption{{{_latex_text(table.title)}}}\n"
            f"  \\label{{tab:{table.name.replace('_', '-')}}}\n"
            f"  \\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}\n    \\toprule\n{_latex_row(head)}    \\midrule\n"
            f"{body}    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}\n"
        )
    return "\n".join(parts)


def _latex_row(cells: Sequence[str]) -> str:
    return "    " + " & ".join(map(_latex_text, cells)) + " \\\\\n"


def _latex_text(text: str) -> str:
    return "".join(_LATEX.get(one, one) for one in _plain(text))


def csv_text(table: Table) -> str:
    """One table with full precision; a share fills four columns (value, ends of its interval, episodes)."""
    wide = [
        next((kind for kind in (Share, Count) if any(isinstance(row[index], kind) for row in table.rows)), None)
        for index in range(len(table.columns))
    ]
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    titles: list[str] = []
    for title, kind in zip(table.columns, wide, strict=True):
        more = {Share: ("low", "high", "n"), Count: ("of",), None: ()}[kind]
        titles += [title, *(f"{title} {one}" for one in more)]
    writer.writerow([_safe(one) for one in titles])
    for row in table.rows:
        cells: list[object] = []
        for cell, kind in zip(row, wide, strict=True):
            blank = {Share: 4, Count: 2, None: 1}[kind]
            cells += (
                [""] * blank if cell is None else cell if isinstance(cell, Share | Count | Score) else [_safe(cell)]
            )
        writer.writerow(cells)
    return target.getvalue()


def _safe(cell: object) -> object:
    """A text that no spreadsheet takes for a formula."""
    if not isinstance(cell, str):
        return cell
    text = _plain(cell)
    return f"'{text}" if text[:1] in {"=", "+", "-", "@"} else text


def _plain(text: str) -> str:
    return _CONTROL.sub(" ", text)


def shown(cell: Cell, decimals: int) -> str:
    """A cell as a reader sees it; a dash where there is nothing."""
    if cell is None:
        return "–"
    if isinstance(cell, Count):
        return f"{cell.n} of {cell.of}"
    if isinstance(cell, Share):
        ends = "" if cell.low is None or cell.high is None else f" ({100 * cell.low:.0f}–{100 * cell.high:.0f})"
        return f"{100 * cell.value:.1f}{ends}"
    if isinstance(cell, Score):
        return f"{cell.value:.1f}"
    return f"{cell:.{decimals}f}" if isinstance(cell, float) else str(cell)
