"""Tables in GitHub-flavoured Markdown. Knows nothing of what is in them."""

import re
from collections.abc import Iterable, Sequence

_MARKUP = re.compile(r"([\\`*_{}\[\]>#])")


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: bool = False) -> str:
    """A table, without a line break at its end.

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
    """Text for a cell, on one line, that a reader of Markdown shows as it is written."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split())).replace("<", "&lt;")
