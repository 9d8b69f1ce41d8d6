"""Attachments of a report: films and frames of run folders, validated and written beside the page.

A run folder is untrusted input. A film is parsed as a record and serialised again; a frame must be a PNG file whose
hash is its name. Invalid files are left out, and the report says so. Writing follows no symbolic links.
"""

import hashlib
import os
import re
import stat
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator.errors import StoreError, reason_of
from evaluator.records.episode import Episode, EpisodeKey, Frame
from evaluator.report.film_record import MOST_BYTES, read, written
from evaluator.store.run_folder import RunFolder

FILMS = "films"
"""Name of the folder of films, in a run folder and beside the page of a report."""
FRAMES = "frames"
"""Name of the folder of frames, in a run folder and beside the page of a report."""
PLAYER = "film.js"
"""Name of the script that plays films, in this package and beside the page of a report. Built from `viewer/`."""
_MOST_FRAME_BYTES = 4_000_000
_PLAIN = re.compile(r"[A-Za-z0-9._-]{1,64}")
_PNG = b"\x89PNG\r\n\x1a\n"


class Attachments(NamedTuple):
    """Files of a run that were written beside the page."""

    films: Mapping[EpisodeKey, str] = {}
    """Episode that has a film → SHA-256 of the record that the film shows."""
    frames: frozenset[str] = frozenset()
    """Names of the frames."""
    left_out: Sequence[str] = ()
    """A sentence for each kind of file that the report leaves out because it is invalid or missing."""


NOTHING = Attachments()
"""Attachments of a run without films and frames."""


class _Keyed(BaseModel):
    """The part of an episode record that is needed to read its key."""

    model_config = ConfigDict(extra="ignore")

    key: EpisodeKey


def film_file(folder: Path, record_sha256: str) -> Path:
    """Path of the film of a record, in a run folder or beside a report. The file need not exist."""
    return folder / FILMS / film_name(record_sha256)


def film_name(record_sha256: str) -> str:
    """File name of the film of a record. It contains the record's hash, because runs may share episode keys."""
    return f"{record_sha256[:24]}.js"


def attached(folder: RunFolder, episodes: Iterable[Episode], target: Path) -> Attachments:
    """Write the films and the frames of a run beside the page of a report.

    Args:
        folder: The run folder.
        episodes: Episodes of the run.
        target: Folder of the report, which may be the run folder.

    Raises:
        StoreError: The records cannot be read, or the folder cannot be written.
    """
    films, spoiled = _films(folder, target)
    frames, missing = _frames(folder, episodes, target)
    return Attachments(films, frames, (*spoiled, *missing))


def _films(folder: RunFolder, target: Path) -> tuple[dict[EpisodeKey, str], list[str]]:
    source = folder.path / FILMS
    names = {file.name for file in source.iterdir()} if source.is_dir() else set[str]()
    records = _records(folder) if names else {}
    found: dict[EpisodeKey, str] = {}
    faults = dict.fromkeys(
        names - {film_name(record) for record in records.values()}, "its name is of no record of this run"
    )
    for key, record in records.items():
        name = film_name(record)
        if name in names:
            try:
                film = read(regular_file(source / name, MOST_BYTES), record)
            except (OSError, ValueError) as error:
                faults[name] = _reason(error)
                continue
            write_anew(own_folder(target / FILMS) / name, written(film))
            found[key] = record
    return found, _told(FILMS, faults, "physment-eval film makes films of its episodes")


def _records(folder: RunFolder) -> dict[EpisodeKey, str]:
    """Map the key of each episode to the SHA-256 of its record; the last of several lines with a key counts."""
    found: dict[EpisodeKey, str] = {}
    for line in folder.episode_lines():
        try:
            found[_Keyed.model_validate_json(line).key] = hashlib.sha256(line).hexdigest()
        except ValidationError as error:
            raise StoreError(f"{folder.episodes_file} has a line without a key: {reason_of(error)}") from error
    return found


def _frames(folder: RunFolder, episodes: Iterable[Episode], target: Path) -> tuple[frozenset[str], list[str]]:
    exchanges = (exchange for episode in episodes for turn in episode.turns for exchange in turn.exchanges)
    names = {frame.name for exchange in exchanges for frame in exchange.frames}
    faults: dict[str, str] = {}
    for name in sorted(names):
        file = f"{name}.png"
        try:
            png = _picture(folder.frames_folder / file, name)
        except (OSError, ValueError) as error:
            faults[file] = _reason(error)
            continue
        write_anew(own_folder(target / FRAMES) / file, png)
    return frozenset(name for name in names if f"{name}.png" not in faults), _told(FRAMES, faults)


def _picture(file: Path, name: str) -> bytes:
    png = regular_file(file, _MOST_FRAME_BYTES)
    if not png.startswith(_PNG) or Frame.of(png).name != name:
        raise ValueError("it is not the picture that the record names")
    return png


def _told(folder: str, faults: Mapping[str, str], advice: str = "") -> list[str]:
    """One sentence about all files that are left out, with the first as an example.

    File names are untrusted, so only plain ones are quoted.
    """
    if not faults:
        return []
    name, reason = min(faults.items())
    many = f"1 file of {folder} is" if len(faults) == 1 else f"{len(faults)} files of {folder} are"
    named = name if _PLAIN.fullmatch(name) else "a file with another name"
    return [f"{many} left out of the report, such as {named}: {reason}{advice and f'; {advice}'}"]


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror or "it cannot be read") if isinstance(error, OSError) else str(error)


def regular_file(file: Path, most: int) -> bytes:
    """Read a regular file of limited size.

    Args:
        file: Path of the file.
        most: Largest allowed size [bytes].

    Raises:
        OSError: The file cannot be read.
        ValueError: It is a symbolic link, not a regular file, or too large.
    """
    kind = file.lstat().st_mode
    if not stat.S_ISREG(kind):
        raise ValueError("it is a link" if stat.S_ISLNK(kind) else "it is no regular file")
    # The file may since have been replaced by a link, or by a pipe, on which open blocks. Windows has neither flag.
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(file, os.O_RDONLY | flags), "rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise ValueError(f"it has more than {most} bytes")
    return content


def own_folder(folder: Path) -> Path:
    """Create a folder that the report writes into, if it is missing, and return it.

    Raises:
        StoreError: The folder cannot be created, or is a symbolic link.
    """
    if folder.is_symlink():
        raise StoreError(f"{folder} is a link, and a report writes only into folders of its own; remove it")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise StoreError(f"{folder} cannot be written: {error.strerror}") from error
    return folder


def write_anew(file: Path, content: bytes) -> None:
    """Write a file unless it exists with this content. An existing file or link at the path is removed first.

    Raises:
        StoreError: The file cannot be written.
    """
    try:
        is_there = not file.is_symlink() and file.is_file() and file.stat().st_size == len(content)
        if is_there and file.read_bytes() == content:
            return
        file.unlink(missing_ok=True)
        with file.open("xb") as stream:
            stream.write(content)
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error


def write_player(folder: Path) -> None:
    """Write the script that plays films into the folder of a report's page.

    Raises:
        StoreError: The script cannot be written.
    """
    write_anew(folder / PLAYER, (files("evaluator.report") / PLAYER).read_bytes())
