"""Folders with a few worlds of level 1."""

import functools
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from evaluator.certify.worlds import Made, make_world
from scenes import default_folder
from scenes.worlds.drawing import structures_of
from scenes.worlds.folders import find_certificate, worlds_of
from scenes.worlds.levels import Difficulty, difficulty_of
from scenes.worlds.orders import PUBLIC
from scenes.worlds.records import as_line, keys_file, lines_file


def write_worlds(folder: Path, indexes: Iterable[int] = (0,), secret: str = PUBLIC, **attributes: object) -> Path:
    """Add worlds of level 1 to a folder. Published worlds are copied, because generating a world takes seconds."""
    difficulty = difficulty_of(1).changed(**attributes)
    folder.mkdir(parents=True, exist_ok=True)
    for index in indexes:
        made = _made(difficulty, secret, index)
        for file, line in ((keys_file(folder, 1), made.certificate), (lines_file(folder, 1), made.record)):
            with file.open("a", encoding="utf-8") as stream:
                stream.write(as_line(line) + "\n")
    return folder


@functools.cache
def _made(difficulty: Difficulty, secret: str, index: int) -> Made:
    """Return a published world if there is one with this index, or generate it; the result is cached."""
    if secret == PUBLIC and difficulty == difficulty_of(1):
        for record in worlds_of(default_folder(), 1):
            certificate = find_certificate(record, default_folder())
            if record.index == index and certificate is not None:
                return Made(record, certificate, Counter())
    return make_world(1, difficulty, secret, index)


def structure_rows(levels: Iterable[int]) -> list[str]:
    """Rows of the table of structures in docs/explanation/worlds.md."""
    rows: list[str] = []
    for level in levels:
        counted = structures_of(difficulty_of(level))
        cells = [str(level), *(_written(number) for number in (sum(counted.values()), *counted.values()))]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def _written(number: int) -> str:
    if number < 1e6:
        return f"{number:,}"
    return f"{number / 1e6:.3g} million" if number < 1e9 else f"{number / 1e6:,.0f} million"
