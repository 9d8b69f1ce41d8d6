"""Compares the terms of docs/reference/glossary.md with the public names of the code and with the pages."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

from tests.builders.paths import DOCS, ROOT

GLOSSARY = DOCS / "reference" / "glossary.md"
EMPTY_WORDS = {"manager", "helper", "helpers", "handler", "util", "utils", "info"}
"""Words that add no meaning to a name."""
BOTH_SIDES = {"Commands", "ToolDescription", "UsageError"}
"""Classes that the laboratory and the evaluator each have, because neither may import the other."""


def rows() -> list[tuple[str, str]]:
    """The terms of the glossary, each with the words to avoid."""
    text = GLOSSARY.read_text(encoding="utf-8")
    return re.findall(r"^\| (?!term |---)([^|]+?) \| [^|]+ \| ([^|]*?) ?\|$", text, flags=re.MULTILINE)


def parts(cell: str) -> list[str]:
    return [part.strip() for part in cell.split(",") if part.strip()]


TERMS = [term for cell, _ in rows() for term in parts(cell)]
AVOIDED = [word for _, cell in rows() for word in parts(cell)]


def public_names() -> dict[str, list[str]]:
    """Public modules, classes and functions of the three packages → where each is defined."""
    found: dict[str, list[str]] = defaultdict(list)
    for path in source_files():
        where = path.relative_to(ROOT).as_posix()
        if not path.stem.startswith("_"):
            found[path.stem].append(where)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            named = isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
            if named and not node.name.startswith("_"):
                found[node.name].append(where)
    return found


def source_files() -> list[Path]:
    return [
        path
        for package in ("physment_mcp", "evaluator", "scenes")
        for path in sorted((ROOT / package).rglob("*.py"))
        if not re.search(r"/(Scene\d+|templates)/", path.as_posix())
    ]


def words_of(name: str) -> set[str]:
    """Split a name in code into words: `PackFiles` and `pack_files` have two."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


def pages() -> list[Path]:
    found = [ROOT / "README.md", ROOT / "CHANGELOG.md", *DOCS.rglob("*.md")]
    return sorted(path for path in found if path != GLOSSARY)


def test_the_glossary_is_read_as_it_is_written() -> None:
    assert len(TERMS) > 60
    assert "reference protocol" in TERMS
    assert "puzzle" in AVOIDED


def test_no_two_public_classes_share_a_name() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for path in source_files():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(path.relative_to(ROOT).as_posix())
    assert {name: found for name, found in places.items() if len(found) > 1 and name not in BOTH_SIDES} == {}


def test_no_public_name_uses_a_word_to_avoid() -> None:
    avoided = EMPTY_WORDS | {word.lower() for word in AVOIDED if " " not in word}
    assert {name: where for name, where in public_names().items() if words_of(name) & avoided} == {}


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_page_uses_a_word_to_avoid(page: Path) -> None:
    text = re.sub(r"`[^`]*`", "", page.read_text(encoding="utf-8"))
    found = [word for word in AVOIDED if re.search(rf"\b{re.escape(word)}s?\b", text, flags=re.IGNORECASE)]
    assert found == []


def test_every_term_is_in_use() -> None:
    names = {word for name in public_names() for word in words_of(name)}
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages()).lower()
    unused = [term for term in TERMS if term.lower() not in text and not words_of(term) & names]
    assert unused == []
