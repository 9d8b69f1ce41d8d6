"""Exports tables as Markdown, CSV and LaTeX. Text is escaped, so agent names cannot inject markup or formulas."""

import csv
import io
import re
from collections.abc import Iterable, Sequence

from evaluator.report.tables import Cell, Count, Noted, Score, Share, Table

_MARKUP = re.compile(r"([\\`*_{}\[\]>#])")


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: bool = False) -> str:
    """Format a Markdown table, without a final line feed.

    Args:
        titles: Titles of the columns.
        rows: Cells in Markdown, each on one line; `|` is escaped here.
        numbers: Whether every column but the first is aligned to the right.
    """
    rule = "|---" + ("|---:" if numbers else "|---") * (len(titles) - 1) + "|"
    return "\n".join([_line(titles), rule, *map(_line, rows)])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def escaped(text: str) -> str:
    """Escape text for a Markdown cell and join its lines."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split())).replace("<", "&lt;")


_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "′": r"$'$",
    "–": "--",
    **{sign: f"\\{sign}" for sign in "$%&#_"},
}
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")


def markdown(tables: Sequence[Table]) -> str:
    """GitHub-flavoured Markdown, with a heading above each table."""
    parts: list[str] = []
    for table in tables:
        titles, *rows = [[escaped(_one_line(cell)) for cell in cells] for cells in _texts(table)]
        note = f"\n{escaped(_one_line(table.note))}\n" if table.note else ""
        parts.append(f"## {table.title}\n\n{markdown_table(titles, rows, numbers=True)}\n{note}")
    return "\n".join(parts)


def _texts(table: Table) -> list[list[str]]:
    """The titles and rows of a table, with every cell formatted for display."""
    return [[*table.columns], *([shown(cell, table.decimals) for cell in row] for row in table.rows)]


def latex(tables: Sequence[Table]) -> str:
    r"""LaTeX: a `tabular` with the rules of `booktabs` for each table, in a `table` with caption and label."""
    parts = ["% Needs \\usepackage{booktabs}.\n"]
    for table in tables:
        titles, *rows = _texts(table)
        body = "".join(_latex_row(row) for row in rows)
        parts.append(
            f"\\begin{{table}}\n  \\centering\n  \\caption{{{_latex_text(table.title)}}}\n"
            f"  \\label{{tab:{table.name.replace('_', '-')}}}\n"
            f"  \\begin{{tabular}}{{l{'r' * (len(titles) - 1)}}}\n    \\toprule\n{_latex_row(titles)}    \\midrule\n"
            f"{body}    \\bottomrule\n  \\end{{tabular}}\n{_latex_note(table)}\\end{{table}}\n"
        )
    return "\n".join(parts)


def _latex_note(table: Table) -> str:
    return f"  \\par {_latex_text(table.note)}\n" if table.note else ""


def _latex_row(cells: Sequence[str]) -> str:
    return "    " + " & ".join(map(_latex_text, cells)) + " \\\\\n"


def _latex_text(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in _one_line(text))


def csv_text(table: Table) -> str:
    """Format a table as CSV with full precision. A share takes four columns: value, ends of its interval, episodes."""
    wide = [
        next((kind for kind in (Share, Count, Noted) if any(isinstance(row[index], kind) for row in table.rows)), None)
        for index in range(len(table.columns))
    ]
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    titles: list[str] = []
    for title, kind in zip(table.columns, wide, strict=True):
        more = {Share: ("low", "high", "n"), Count: ("of",), Noted: ("note",), None: ()}[kind]
        titles += [title, *(f"{title} {part}" for part in more)]
    writer.writerow([_safe(title) for title in titles])
    for row in table.rows:
        cells: list[object] = []
        for cell, kind in zip(row, wide, strict=True):
            blank = {Share: 4, Count: 2, Noted: 2, None: 1}[kind]
            if cell is None:
                cells += [""] * blank
            elif isinstance(cell, Share | Count | Noted | Score):
                cells += ["" if part is None else part for part in cell]
            else:
                cells += [_safe(cell), *[""] * (blank - 1)]
        writer.writerow(cells)
    return target.getvalue()


def _safe(cell: object) -> object:
    """Prefix text with a quote if a spreadsheet could interpret it as a formula; other cells are unchanged."""
    if not isinstance(cell, str):
        return cell
    text = _one_line(cell)
    return f"'{text}" if text[:1] in {"=", "+", "-", "@"} else text


def _one_line(text: str) -> str:
    return _CONTROL.sub(" ", text)


def shown(cell: Cell, decimals: int) -> str:
    """Format a cell for display; a dash if it is empty."""
    if cell is None:
        return "–"
    if isinstance(cell, Count):
        return f"{cell.n} of {cell.of}"
    if isinstance(cell, Share):
        ends = "" if cell.low is None or cell.high is None else f" ({100 * cell.low:.0f}–{100 * cell.high:.0f})"
        return f"{100 * cell.value:.1f}{ends}"
    if isinstance(cell, Score):
        return f"{cell.value:.1f}"
    if isinstance(cell, Noted):
        note = f" ({cell.note})" if cell.note else ""
        return ("–" if cell.value is None else f"{cell.value:.3f}") + note
    return f"{cell:.{decimals}f}" if isinstance(cell, float) else str(cell)
