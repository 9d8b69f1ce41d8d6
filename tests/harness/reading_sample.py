"""Draws random docstrings and paragraphs. A person who does not know the project then judges whether they are clear.

The random seed is the hash of the last commit and a salt; another salt draws other texts of the same commit.

python -m tests.harness.reading_sample [COUNT] [SALT]
"""

import argparse
import ast
import random
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tests.builders.paths import ROOT

SHORTEST_WORDS = 8
"""Texts with fewer words are not drawn, because there is too little to judge."""

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
    """Return file path and text of every docstring and paragraph that may be drawn."""
    code = [path for path in tracked("*.py") if not re.match(r"scenes/(Scene\d+|templates)/", path.as_posix())]
    pages = [path for path in tracked("*.md") if not path.as_posix().startswith(GENERATED)]
    found = [(path, text) for path in code for text in docstrings((ROOT / path).read_text(encoding="utf-8"))]
    found += [(path, text) for path in pages for text in paragraphs((ROOT / path).read_text(encoding="utf-8"))]
    return [(path.as_posix(), text) for path, text in found if len(text.split()) >= SHORTEST_WORDS]


def main() -> None:
    """Print the drawn texts, numbered."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("count", nargs="?", type=int, default=30, help="number of texts (default: 30)")
    parser.add_argument("salt", nargs="?", default="", help="added to the seed")
    options = parser.parse_args()
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    drawn = random.Random(head.stdout.strip() + options.salt).sample(texts(), options.count)
    for number, (place, text) in enumerate(drawn, start=1):
        print(f"{number}. {place}\n\n{text}\n")


if __name__ == "__main__":
    main()
