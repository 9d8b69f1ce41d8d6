"""Films beside a run, as the report finds them: the name of each file, the hash of the record that it must show."""

import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator.errors import StoreError
from evaluator.records import EpisodeKey
from evaluator.store import RunFolder

FOLDER = "films"
"""Folder for the films, in the folder of their run."""
PLAYER = "film.js"
"""The script that plays films, beside the page of a report and in this package. Built from `viewer/`."""


class _Keyed(BaseModel):
    """Of the line of an episode, what tells which one it is."""

    model_config = ConfigDict(extra="ignore")

    key: EpisodeKey


def film_file(folder: RunFolder, key: EpisodeKey) -> Path:
    """Where the film of an episode is, or would be."""
    return folder.path / FOLDER / film_name(key)


def film_name(key: EpisodeKey) -> str:
    """The name of the film of an episode."""
    return f"{hashlib.sha256(key.model_dump_json().encode()).hexdigest()[:24]}.js"


def filmed(folder: RunFolder) -> Mapping[EpisodeKey, str]:
    """The episodes that have a film → SHA-256 of the last line with their key.

    Raises:
        StoreError: The records cannot be read.
    """
    if not (folder.path / FOLDER).is_dir():
        return {}
    found: dict[EpisodeKey, str] = {}
    for line in folder.episode_lines():
        try:
            key = _Keyed.model_validate_json(line).key
        except ValidationError as error:
            raise StoreError(f"{folder.episodes_file} has a line without a key: {error}") from error
        found[key] = hashlib.sha256(line).hexdigest()
    return {key: digest for key, digest in found.items() if film_file(folder, key).is_file()}


def write_player(folder: Path) -> None:
    """Put the player beside the page of a report.

    Raises:
        StoreError: It cannot be written.
    """
    try:
        (folder / PLAYER).write_bytes((files("evaluator.report") / PLAYER).read_bytes())
    except OSError as error:
        raise StoreError(f"{folder / PLAYER} cannot be written: {error.strerror}") from error
