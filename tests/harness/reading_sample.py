"""Draw random docstrings and paragraphs, which a person who never saw the project reads for clarity.

The hash of the last commit is the seed, and a salt gives other texts of the same commit:
python -m tests.harness.reading_sample [COUNT] [SALT]
"""

import ast
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.builders.paths import ROOT

SHORTEST_WORDS = 8
"""Shorter texts say too little to be judged."""

GENERATED = ("docs/reference/scenes", "docs/reference/tools.md", "docs/reference/cli.md", "docs/reference/api.md")


def tracked(pattern: str) -> list[Path]:
    """Files that git tracks, by a pattern such as `*.py`."""
    done = subprocess.run(["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True, check=True)
    return [Path(name) for name in done.stdout.splitlines()]


def docstrings(source: str) -> Iterator[str]:
    """Every docstring of a module, its classes and its functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def paragraphs(page: str) -> Iterator[str]:
    """Paragraphs of a page in Markdown: no code, tables, headings or pictures."""
    prose = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
    for block in re.split(r"\n\s*\n", prose):
        if not re.match(r"\s*[#|<!]", block):
            yield block.strip()


def texts() -> list[tuple[str, str]]:
    """Place and text of everything that may be drawn."""
    code = [path for path in tracked("*.py") if not re.match(r"scenes/(Scene\d+|templates)/", path.as_posix())]
    pages = [path for path in tracked("*.md") if not path.as_posix().startswith(GENERATED)]
    found = [(path, text) for path in code for text in docstrings((ROOT / path).read_text(encoding="utf-8"))]
    found += [(path, text) for path in pages for text in paragraphs((ROOT / path).read_text(encoding="utf-8"))]
    return [(path.as_posix(), text) for path, text in found if len(text.split()) >= SHORTEST_WORDS]


def main() -> None:
    """Print the drawn texts, numbered."""
    count, salt = int(sys.argv[1]) if len(sys.argv) > 1 else 30, sys.argv[2] if len(sys.argv) > 2 else ""
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    drawn = random.Random(head.stdout.strip() + salt).sample(texts(), count)
    for number, (place, text) in enumerate(drawn, start=1):
        print(f"{number}. {place}\n\n{text}\n")


if __name__ == "__main__":
    main()
