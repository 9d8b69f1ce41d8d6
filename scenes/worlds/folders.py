"""Looks up the worlds in a folder by reference, level and split."""

import functools
from collections.abc import Sequence
from pathlib import Path

from scenes.errors import WorldError
from scenes.world_names import parse_worlds, reference_of, scene_id_of
from scenes.worlds.levels import LEVELS
from scenes.worlds.records import (
    Certificate,
    WorldRecord,
    keys_file,
    lines_file,
    read_certificate,
    read_record,
    read_records,
)

PUBLISHED = Path("worlds", "public")
"""Folder of the suite's published worlds, below the folder of packs."""


def find_worlds(text: str, folder: Path) -> list[WorldRecord]:
    """Return the worlds that a reference names, in ascending order.

    Raises:
        WorldError: It is malformed, or one of the worlds does not exist.
    """
    levels, indexes = parse_worlds(text)
    return [record for level in levels for record in _of_level(folder, level, indexes)]


def worlds_of(folder: Path, level: int) -> tuple[WorldRecord, ...]:
    """All worlds of a level in a folder of packs or worlds, by ascending index.

    Raises:
        WorldError: There is no such level, it has no worlds, or a line is not a record.
    """
    place = _place(folder, level)
    return _records(place, level, _stamp(lines_file(place, level)))


def levels_of(folder: Path) -> list[int]:
    """Return the levels that have worlds in a folder of packs or worlds."""
    places = (folder, folder / PUBLISHED)
    return [level for level in LEVELS if any(lines_file(place, level).exists() for place in places)]


def find_record(level: int, index: int, folder: Path) -> WorldRecord:
    """The record of a world in a folder of packs or worlds.

    Raises:
        WorldError: There is none, or it cannot be read.
    """
    place = _place(folder, level)
    record = _record(place, level, index, _stamp(lines_file(place, level)))
    if record is None:
        there = len(worlds_of(folder, level))
        name = reference_of(scene_id_of(level, index))
        raise WorldError(f"there is no {name}; level {level} has {there} worlds here")
    return record


def find_certificate(record: WorldRecord, folder: Path) -> Certificate | None:
    """The certificate of a world; None in a folder without answer keys.

    Raises:
        WorldError: A line is not a certificate.
    """
    place = _place(folder, record.level)
    return _certificate(place, record.level, record.index, _stamp(keys_file(place, record.level)))


def _of_level(folder: Path, level: int, indexes: Sequence[int] | None) -> list[WorldRecord]:
    if indexes is None:
        return list(worlds_of(folder, level))
    if len(indexes) == 1:
        return [find_record(level, indexes[0], folder)]
    there = {record.index: record for record in worlds_of(folder, level)}
    missing = next((index for index in indexes if index not in there), None)
    return [find_record(level, missing, folder)] if missing is not None else [there[index] for index in indexes]


def _place(folder: Path, level: int) -> Path:
    """The folder with the records of a level."""
    if level not in LEVELS:
        raise WorldError(f"there is no level {level}; levels are {LEVELS[0]} to {LEVELS[-1]}")
    places = (folder, folder / PUBLISHED)
    found = next((place for place in places if lines_file(place, level).exists()), None)
    if found is None:
        raise WorldError(
            f"there are no worlds of level {level} here; `physment-eval worlds make` makes them, --scenes-dir names"
            " their folder"
        )
    return found


@functools.lru_cache(16)
def _records(place: Path, level: int, stamp: int | None) -> tuple[WorldRecord, ...]:
    """The records of a level, cached until the file changes."""
    del stamp
    return tuple(sorted(read_records(place, level), key=lambda record: record.index))


@functools.lru_cache(4096)
def _record(place: Path, level: int, index: int, stamp: int | None) -> WorldRecord | None:
    del stamp
    return read_record(place, level, index)


@functools.lru_cache(4096)
def _certificate(place: Path, level: int, index: int, stamp: int | None) -> Certificate | None:
    del stamp
    return read_certificate(place, level, index)


def _stamp(file: Path) -> int | None:
    """Return a value that changes with the file; None if there is no file."""
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return None
