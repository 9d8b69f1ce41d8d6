"""The navigation of the website, made from the index of the documentation: its sections, and their links in order."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

_SECTION = re.compile(r"^## (.+?)\n(.*?)(?=^## |\Z)", re.DOTALL | re.MULTILINE)
_ENTRY = re.compile(r"^- \[(.+?)\]\((.+?\.md)\)", re.MULTILINE)
_TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
_INDEX = "index.md"
_RECORDS = "decisions/README.md"
_SCENES = "reference/scenes.md"
_SCENE = re.compile(r"reference/scenes/scene(\d+)\.md")


def add_navigation(folder: Path, pages: Sequence[str]) -> None:
    """Append `toctree` directives to the index and to the list of decisions.

    Args:
        folder: Folder of the site's pages.
        pages: Names of the pages.

    Raises:
        LookupError: A page belongs to no section.
    """
    index = (folder / _INDEX).read_text(encoding="utf-8")
    sections = {title: _ENTRY.findall(text) for title, text in _SECTION.findall(index) if _ENTRY.search(text)}
    sections["Project"] = [
        ("Decisions", _RECORDS),
        *((_title(folder / name), name) for name in pages if name.startswith("project/")),
    ]
    scenes = sorted((int(found[1]), name) for name in pages if (found := _SCENE.fullmatch(name)))
    records = [name for name in pages if name.startswith("decisions/") and name != _RECORDS]
    listed = {name for entries in sections.values() for _, name in entries}
    if lost := sorted(set(pages) - listed - set(records) - {name for _, name in scenes} - {_INDEX}):
        raise LookupError(f"docs/index.md lists no {', '.join(lost)} in a section")
    _append(folder / _INDEX, "".join(_tree(title, entries) for title, entries in sections.items()))
    if scenes:
        own = [(_title(folder / name), name.removeprefix("reference/")) for _, name in scenes]
        _append(folder / _SCENES, _tree("", own))
    _append(folder / _RECORDS, _tree("", [(_title(folder / name), Path(name).name) for name in records]))


def _append(page: Path, text: str) -> None:
    page.write_text(page.read_text(encoding="utf-8") + text, encoding="utf-8")


def _title(page: Path) -> str:
    found = _TITLE.search(page.read_text(encoding="utf-8"))
    if found is None:
        raise LookupError(f"{page.name} has no heading")
    return found[1].replace("`", "")


def _tree(caption: str, entries: Iterable[tuple[str, str]]) -> str:
    lines = [f"{title} <{name.removesuffix('.md')}>" for title, name in entries]
    options = [":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, "", *lines, "```", ""])
